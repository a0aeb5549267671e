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

template <int R>
void columns_radius(const Value* const* rows, const Value* taps, int n, Value* __restrict out) {
    const Value* row[2 * R + 1];
    Value tap[R + 1];
    for (int i = 0; i <= 2 * R; ++i) row[i] = rows[i];
    for (int i = 0; i <= R; ++i) tap[i] = taps[i];
    for (int x = 0; x < n; ++x) {
        int sum = row[R][x] * tap[0];
        for (int i = 1; i <= R; ++i) sum += (row[R - i][x] + row[R + i][x]) * tap[i];
        out[x] = static_cast<Value>(sum);
    }
}

void filter_columns(const Value* const* rows, const Value* taps, int radius, int n, Value* out) {
    switch (radius) {
        case 1:
            return columns_radius<1>(rows, taps, n, out);
        case 2:
            return columns_radius<2>(rows, taps, n, out);
        case 3:
            return columns_radius<3>(rows, taps, n, out);
        case 4:
            return columns_radius<4>(rows, taps, n, out);
        case 5:
            return columns_radius<5>(rows, taps, n, out);
        case 6:
            return columns_radius<6>(rows, taps, n, out);
        case 7:
            return columns_radius<7>(rows, taps, n, out);
        default:
            return columns_radius<8>(rows, taps, n, out);
    }
}

void blur_row(const Value* row, const Value* taps, int radius, int n, Value* out) {
    switch (radius) {
        case 1:
            return blur_radius<1>(row, taps, n, out);
        case 2:
            return blur_radius<2>(row, taps, n, out);
        case 3:
            return blur_radius<3>(row, taps, n, out);
        case 4:
            return blur_radius<4>(row, taps, n, out);
        case 5:
            return blur_radius<5>(row, taps, n, out);
        case 6:
            return blur_radius<6>(row, taps, n, out);
        case 7:
            return blur_radius<7>(row, taps, n, out);
        default:
            return blur_radius<8>(row, taps, n, out);
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

void halve_columns(const Value* const* rows, bool odd, int n, Value* __restrict out) {
    const Value *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
    if (odd) {
        const Value* e = rows[4];
        for (int x = 0; x < n; ++x) out[x] = static_cast<Value>(14 * c[x] + 8 * (b[x] + d[x]) + a[x] + e[x]);
    } else {
        for (int x = 0; x < n; ++x) out[x] = static_cast<Value>(3 * (b[x] + c[x]) + a[x] + d[x]);
    }
}

void halve_row(const Value* in, bool odd, int shift, int n, Value* __restrict out) {
    const int half = 1 << (shift - 1);
    if (odd) {
        for (int x = 0; x < n; ++x) {
            const Value* p = in + 2 * x;
            out[x] = static_cast<Value>((14 * p[0] + 8 * (p[-1] + p[1]) + p[-2] + p[2] + half) >> shift);
        }
    } else {
        for (int x = 0; x < n; ++x) {
            const Value* p = in + 2 * x;
            out[x] = static_cast<Value>((3 * (p[0] + p[1]) + p[-1] + p[2] + half) >> shift);
        }
    }
}

// Between four values; `near` and `far` are rows, a and b columns with weights wa and wb.
inline float bilinear(const float* near, const float* far, int a, int b, float wn, float wf, float wa,
                      float wb) {
    return (wn * wa * near[a] + wf * wb * far[b]) + (wn * wb * near[b] + wf * wa * far[a]);
}

void stretch(const float* near, const float* far, float weight, bool odd, int n, float* __restrict out) {
    const float rest = 1.0f - weight;
    const auto at = [&](int a, int b, float w) {
        return bilinear(near, far, a, b, weight, rest, w, 1.0f - w);
    };
    if (odd) {
        for (int x = 0; x + 1 < n; ++x) {
            out[2 * x] = at(x, x, 0.5f);
            out[2 * x + 1] = at(x, x + 1, 0.5f);
        }
        out[2 * n - 2] = at(n - 1, n - 1, 0.5f);
    } else {
        out[0] = at(0, 0, 0.75f);
        for (int x = 0; x + 1 < n; ++x) {
            out[2 * x + 1] = at(x, x + 1, 0.75f);
            out[2 * x + 2] = at(x + 1, x, 0.75f);
        }
        out[2 * n - 1] = at(n - 1, n - 1, 0.75f);
    }
}

}  // namespace

extern const RowKernels kernels = {transfer,          filter_columns,  blur_row,
                                   gradient_products, corner_response, peaks,
                                   halve_columns,     halve_row,       stretch};

}  // namespace facetcam::FACETCAM_ISA
