// Included once per instruction set with FACETCAM_ISA naming the namespace. No standard-library templates
// here: an inline function compiled for AVX-512 must never be the copy the linker keeps for everybody.
#include <cstring>

#include "corner_kernels.hpp"
#include "corner_windows.inl"

namespace facetcam::FACETCAM_ISA {
namespace {

#ifdef __AVX512BW__
// The table lies in eight registers: four permutations and three choices replace 32 loads.
void transfer(const std::uint8_t* pixels, const Value* table, int n, Value* __restrict out) {
    __m512i part[8];
    for (int i = 0; i < 8; ++i) part[i] = _mm512_loadu_si512(table + 32 * i);
    const auto look_up = [&](__m256i bytes) {
        const __m512i index = _mm512_cvtepu8_epi16(bytes);
        const __mmask32 upper = _mm512_test_epi16_mask(index, _mm512_set1_epi16(128)),
                        odd = _mm512_test_epi16_mask(index, _mm512_set1_epi16(64));
        const __m512i a = _mm512_permutex2var_epi16(part[0], index, part[1]),
                      b = _mm512_permutex2var_epi16(part[2], index, part[3]),
                      c = _mm512_permutex2var_epi16(part[4], index, part[5]),
                      d = _mm512_permutex2var_epi16(part[6], index, part[7]);
        return _mm512_mask_blend_epi16(upper, _mm512_mask_blend_epi16(odd, a, b),
                                       _mm512_mask_blend_epi16(odd, c, d));
    };
    int x = 0;
    for (; x + 32 <= n; x += 32)
        _mm512_storeu_si512(out + x,
                            look_up(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(pixels + x))));
    for (; x < n; ++x) out[x] = table[pixels[x]];
}
#else
void transfer(const std::uint8_t* pixels, const Value* table, int n, Value* __restrict out) {
    for (int x = 0; x < n; ++x) out[x] = table[pixels[x]];
}
#endif

// a * b / 2^15 rounded: one instruction on most machines.
inline Value scaled(Value a, Value b) { return static_cast<Value>((((a * b) >> 14) + 1) >> 1); }

template <int R>
void filter_radius(const Value* const* rows, const Value* taps, int n, Value* __restrict out) {
    const Value* row[2 * R + 1];
    Value tap[R + 1];
    for (int i = 0; i <= 2 * R; ++i) row[i] = rows[i];
    for (int i = 0; i <= R; ++i) tap[i] = taps[i];
    for (int x = 0; x < n; ++x) {
        Value sum = scaled(row[R][x], tap[0]);
        for (int i = 1; i <= R; ++i) {
            const Value pair = static_cast<Value>(row[R - i][x] + row[R + i][x]);
            sum = static_cast<Value>(sum + scaled(pair, tap[i]));
        }
        out[x] = sum;
    }
}

void symmetric_filter(const Value* const* rows, const Value* taps, int radius, int n, Value* out) {
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

// 1 / sqrt(s) to 3.5 %, by halving the exponent: exact enough for a weight, and the same everywhere.
inline float inverse_root(float s) {
    std::int32_t bits;
    std::memcpy(&bits, &s, sizeof bits);
    bits = 0x5f375a86 - (bits >> 1);
    float guess;
    std::memcpy(&guess, &bits, sizeof guess);
    return guess;
}

// To the nearest integer, halves to even: the low bits of the sum with a large number.
inline Value rounded(float v) {
    const float shifted = v + 12582912.0f;
    std::int32_t bits;
    std::memcpy(&bits, &shifted, sizeof bits);
    return static_cast<Value>(bits);
}

inline Value limited(Value v, Value most) {
    const Value below = v < most ? v : most, least = static_cast<Value>(-most);
    return below > least ? below : least;
}

void gradient_products(const Value* above, const Value* row, const Value* below, float gain, float floor,
                       Value most, int n, Value* __restrict xx, Value* __restrict xy, Value* __restrict yy) {
    for (int x = 0; x < n; ++x) {
        const float gx = limited(static_cast<Value>(row[x + 1] - row[x - 1]), most);
        const float gy = limited(static_cast<Value>(below[x] - above[x]), most);
        const float gxx = gx * gx, gyy = gy * gy;
        const float weight = gain * inverse_root(gxx + gyy + floor);
        xx[x] = rounded(gxx * weight);
        xy[x] = rounded(gx * gy * weight);
        yy[x] = rounded(gyy * weight);
    }
}

void window_rows(const Value* const* rows, const Value* taps, int radius, int n, Value* out) {
    switch (radius) {
        case 1:
            return window_radius<1>(rows, taps, n, out);
        case 2:
            return window_radius<2>(rows, taps, n, out);
        case 3:
            return window_radius<3>(rows, taps, n, out);
        case 4:
            return window_radius<4>(rows, taps, n, out);
        case 5:
            return window_radius<5>(rows, taps, n, out);
        case 6:
            return window_radius<6>(rows, taps, n, out);
        case 7:
            return window_radius<7>(rows, taps, n, out);
        default:
            return window_radius<8>(rows, taps, n, out);
    }
}

void corner_response(const Value* xx, const Value* xy, const Value* yy, const Value* taps, int radius,
                     float alpha, float scale, const float* coarse, float weight, int n, float* out) {
    switch (radius) {
        case 1:
            return response_radius<1>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 2:
            return response_radius<2>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 3:
            return response_radius<3>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 4:
            return response_radius<4>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 5:
            return response_radius<5>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 6:
            return response_radius<6>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        case 7:
            return response_radius<7>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
        default:
            return response_radius<8>(xx, xy, yy, taps, alpha, scale, coarse, weight, n, out);
    }
}

void peaks(const float* above, const float* row, const float* below, float floor, int n,
           std::uint8_t* __restrict flags) {
    for (int x = 0; x < n; ++x) {
        const float bar = larger(larger(above[x], below[x]), larger(row[x - 1], row[x + 1]));
        flags[x] = row[x] >= bar && row[x] > floor;
    }
}

void halve_row(const Value* in, bool odd, int n, Value* __restrict out) {
    if (odd) {
        for (int x = 0; x < n; ++x) {
            const Value* p = in + 2 * x;
            out[x] = static_cast<Value>((14 * p[0] + 8 * (p[-1] + p[1]) + p[-2] + p[2] + 16) >> 5);
        }
    } else {
        for (int x = 0; x < n; ++x) {
            const Value* p = in + 2 * x;
            out[x] = static_cast<Value>((3 * (p[0] + p[1]) + p[-1] + p[2] + 4) >> 3);
        }
    }
}

void halve_column(const Value* const* rows, bool odd, int n, Value* __restrict out) {
    const Value *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    if (odd) {
        const Value* e = rows[4];
        for (int x = 0; x < n; ++x)
            out[x] = static_cast<Value>((14 * c[x] + 8 * (b[x] + d[x]) + a[x] + e[x] + 16) >> 5);
    } else {
        for (int x = 0; x < n; ++x) out[x] = static_cast<Value>((3 * (b[x] + c[x]) + a[x] + d[x] + 4) >> 3);
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

extern const RowKernels kernels = {
    transfer, symmetric_filter, gradient_products, window_rows, corner_response,
    peaks,    halve_row,        halve_column,      blend,       stretch_row};

}  // namespace facetcam::FACETCAM_ISA
