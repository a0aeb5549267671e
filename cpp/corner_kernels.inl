// Included once per instruction set with FACETCAM_ISA naming the namespace. No standard-library templates
// here: an inline function compiled for AVX-512 must never be the copy the linker keeps for everybody.
#include "corner_kernels.hpp"

namespace facetcam::FACETCAM_ISA {
namespace {

extern "C" float sqrtf(float);

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
        const float weight = 1.0f / (sqrtf(gxx + gyy) + compression);
        xx[x] = gxx * weight;
        xy[x] = gx * gy * weight;
        yy[x] = gyy * weight;
    }
}

void harris(const float* xx, const float* xy, const float* yy, float alpha, int n, float* __restrict out) {
    for (int x = 0; x < n; ++x) {
        const float trace = xx[x] + yy[x];
        out[x] = xx[x] * yy[x] - xy[x] * xy[x] - alpha * trace * trace;
    }
}

inline float larger(float a, float b) { return a > b ? a : b; }

void peaks(const float* above, const float* row, const float* below, float floor, int n,
           std::uint8_t* __restrict flags) {
    for (int x = 0; x < n; ++x) {
        const float sides = larger(larger(above[x - 1], above[x + 1]), larger(below[x - 1], below[x + 1]));
        const float cross = larger(larger(above[x], below[x]), larger(row[x - 1], row[x + 1]));
        const float bar = larger(sides, cross);
        flags[x] = row[x] >= bar && row[x] > floor;
    }
}

}  // namespace

extern const RowKernels kernels = {symmetric_filter, gradient_products, harris, peaks};

}  // namespace facetcam::FACETCAM_ISA
