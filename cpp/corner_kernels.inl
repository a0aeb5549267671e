// Included once per instruction set with FACETCAM_ISA naming the namespace. No standard-library templates
// here: an inline function compiled for AVX-512 must never be the copy the linker keeps for everybody.
#include "corner_kernels.hpp"

namespace facetcam::FACETCAM_ISA {
namespace {

template <int R>
void filter_radius(const float* const* rows, const float* taps, int n, float* __restrict out) {
    const float* row[2 * R + 1];
    float tap[R + 1];
    for (int i = 0; i <= 2 * R; ++i) row[i] = rows[i];
    for (int i = 0; i <= R; ++i) tap[i] = taps[i];
    for (int x = 0; x < n; ++x) {
        float sum = tap[0] * row[R][x];
        for (int i = 1; i <= R; ++i) sum += tap[i] * (row[R - i][x] + row[R + i][x]);
        out[x] = sum;
    }
}

void symmetric_filter(const float* const* rows, const float* taps, int radius, int n, float* out) {
    switch (radius) {
        case 1:
            return filter_radius<1>(rows, taps, n, out);
        case 2:
            return filter_radius<2>(rows, taps, n, out);
        case 3:
            return filter_radius<3>(rows, taps, n, out);
        case 4:
            return filter_radius<4>(rows, taps, n, out);
        case 5:
            return filter_radius<5>(rows, taps, n, out);
        case 6:
            return filter_radius<6>(rows, taps, n, out);
        case 7:
            return filter_radius<7>(rows, taps, n, out);
        default:
            return filter_radius<8>(rows, taps, n, out);
    }
}

void gradient_products(const float* above, const float* row, const float* below, float gain,
                       float compression, int n, float* __restrict xx, float* __restrict xy,
                       float* __restrict yy) {
    for (int x = 0; x < n; ++x) {
        const float gx = gain * (row[x + 1] - row[x - 1]);
        const float gy = gain * (below[x] - above[x]);
        const float gxx = gx * gx, gyy = gy * gy;
        const float weight = compression > 0.0f ? 1.0f / (__builtin_sqrtf(gxx + gyy) + compression) : 1.0f;
        xx[x] = gxx * weight;
        xy[x] = gx * gy * weight;
        yy[x] = gyy * weight;
    }
}

inline float larger(float a, float b) { return a > b ? a : b; }

template <int R>
inline float windowed(const float* p, const float* taps) {
    float sum = taps[0] * p[0];
    for (int i = 1; i <= R; ++i) sum += taps[i] * (p[-i] + p[i]);
    return sum;
}

template <int R>
void response_radius(const float* xx, const float* xy, const float* yy, const float* taps, float alpha,
                     const float* coarse, float weight, int n, float* __restrict out) {
    float tap[R + 1];
    for (int i = 0; i <= R; ++i) tap[i] = taps[i];
    for (int x = 0; x < n; ++x) {
        const float a = windowed<R>(xx + x, tap), b = windowed<R>(xy + x, tap), c = windowed<R>(yy + x, tap);
        const float trace = a + c;
        const float measure = a * c - b * b - alpha * trace * trace;
        out[x] = __builtin_sqrtf(larger(measure, 0.0f)) + weight * coarse[x];
    }
}

void corner_response(const float* xx, const float* xy, const float* yy, const float* taps, int radius,
                     float alpha, const float* coarse, float weight, int n, float* out) {
    switch (radius) {
        case 1:
            return response_radius<1>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 2:
            return response_radius<2>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 3:
            return response_radius<3>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 4:
            return response_radius<4>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 5:
            return response_radius<5>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 6:
            return response_radius<6>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        case 7:
            return response_radius<7>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
        default:
            return response_radius<8>(xx, xy, yy, taps, alpha, coarse, weight, n, out);
    }
}

void peaks(const float* above, const float* row, const float* below, float floor, int n,
           std::uint8_t* __restrict flags) {
    for (int x = 0; x < n; ++x) {
        const float sides = larger(larger(above[x - 1], above[x + 1]), larger(below[x - 1], below[x + 1]));
        const float cross = larger(larger(above[x], below[x]), larger(row[x - 1], row[x + 1]));
        const float bar = larger(sides, cross);
        flags[x] = row[x] >= bar && row[x] > floor;
    }
}

void halve_row(const float* in, bool odd, int n, float* __restrict out) {
    if (odd) {
        for (int x = 0; x < n; ++x) {
            const float* p = in + 2 * x;
            out[x] = 0.4375f * p[0] + 0.25f * (p[-1] + p[1]) + 0.03125f * (p[-2] + p[2]);
        }
    } else {
        for (int x = 0; x < n; ++x) {
            const float* p = in + 2 * x;
            out[x] = 0.375f * (p[0] + p[1]) + 0.125f * (p[-1] + p[2]);
        }
    }
}

void halve_column(const float* const* rows, bool odd, int n, float* __restrict out) {
    const float *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    if (odd) {
        const float* e = rows[4];
        for (int x = 0; x < n; ++x)
            out[x] = 0.4375f * c[x] + 0.25f * (b[x] + d[x]) + 0.03125f * (a[x] + e[x]);
    } else {
        for (int x = 0; x < n; ++x) out[x] = 0.375f * (b[x] + c[x]) + 0.125f * (a[x] + d[x]);
    }
}

void blend(const float* a, const float* b, float weight, int n, float* __restrict out) {
    const float rest = 1.0f - weight;
    for (int x = 0; x < n; ++x) out[x] = weight * a[x] + rest * b[x];
}

void stretch_row(const float* in, bool odd, int n, float* __restrict out) {
    if (odd) {
        for (int x = 0; x + 1 < n; ++x) {
            out[2 * x] = in[x];
            out[2 * x + 1] = 0.5f * (in[x] + in[x + 1]);
        }
        out[2 * n - 2] = in[n - 1];
    } else {
        out[0] = in[0];
        for (int x = 0; x + 1 < n; ++x) {
            out[2 * x + 1] = 0.75f * in[x] + 0.25f * in[x + 1];
            out[2 * x + 2] = 0.25f * in[x] + 0.75f * in[x + 1];
        }
        out[2 * n - 1] = in[n - 1];
    }
}

}  // namespace

extern const RowKernels kernels = {symmetric_filter, gradient_products, corner_response, peaks,
                                   halve_row,        halve_column,      blend,           stretch_row};

}  // namespace facetcam::FACETCAM_ISA
