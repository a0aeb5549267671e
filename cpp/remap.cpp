#include "remap.hpp"

#include <algorithm>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace facetcam {

namespace {

constexpr int kOne = 1 << kFractionBits;
// Bits kept below a byte between the two steps: with them it still multiplies as a 16-bit word.
constexpr int kGuard = 6;

inline std::uint8_t blend(std::uint8_t a, std::uint8_t b, std::uint8_t c, std::uint8_t d, int right,
                          int down) {
    const int upper = (a * (kOne - right) + b * right) >> (kFractionBits - kGuard);
    const int lower = (c * (kOne - right) + d * right) >> (kFractionBits - kGuard);
    const int half = 1 << (kFractionBits + kGuard - 1);
    return static_cast<std::uint8_t>((upper * (kOne - down) + lower * down + half) >>
                                     (kFractionBits + kGuard));
}

inline float blend(float a, float b, float c, float d, int right, int down) {
    const float x = static_cast<float>(right) / kOne, y = static_cast<float>(down) / kOne;
    const float upper = a + (b - a) * x, lower = c + (d - c) * x;
    return upper + (lower - upper) * y;
}

inline std::uint16_t blend(std::uint16_t a, std::uint16_t b, std::uint16_t c, std::uint16_t d, int right,
                           int down) {
    const float value = blend(static_cast<float>(a), static_cast<float>(b), static_cast<float>(c),
                              static_cast<float>(d), right, down);
    return static_cast<std::uint16_t>(value + 0.5f);
}

template <class T, int channels>
inline void blend_pixel(const T* upper, const T* lower, const Source& source, T* pixel) {
    for (int c = 0; c < channels; ++c)
        pixel[c] =
            blend(upper[c], upper[c + channels], lower[c], lower[c + channels], source.right, source.down);
}

#ifdef __SSE2__
// The three channels at once, with the same arithmetic as above.
template <>
inline void blend_pixel<std::uint8_t, 3>(const std::uint8_t* upper, const std::uint8_t* lower,
                                         const Source& source, std::uint8_t* pixel) {
    const auto load = [](const std::uint8_t* p) {
        return _mm_loadl_epi64(reinterpret_cast<const __m128i*>(p));
    };
    const auto weights = [](int far) { return _mm_set1_epi32((far << 16) | (kOne - far)); };
    const __m128i right = weights(source.right), down = weights(source.down), zero = _mm_setzero_si128();
    const auto across = [&](__m128i row) {
        const __m128i pairs = _mm_unpacklo_epi8(row, _mm_srli_si128(row, 3));
        return _mm_srli_epi32(_mm_madd_epi16(_mm_unpacklo_epi8(pairs, zero), right), kFractionBits - kGuard);
    };
    // Eight bytes hold both pixels and two more: taken after them above, before them below, inside the image.
    const __m128i rows = _mm_packs_epi32(across(load(upper)), across(_mm_srli_si128(load(lower - 2), 2)));
    const __m128i half = _mm_set1_epi32(1 << (kFractionBits + kGuard - 1));
    const __m128i sums = _mm_madd_epi16(_mm_unpacklo_epi16(rows, _mm_srli_si128(rows, 8)), down);
    const __m128i words = _mm_srli_epi32(_mm_add_epi32(sums, half), kFractionBits + kGuard);
    const int bytes = _mm_cvtsi128_si32(_mm_packus_epi16(_mm_packs_epi32(words, zero), zero));
    std::memcpy(pixel, &bytes, 3);
}
#endif

}  // namespace

template <class T, int channels>
void remap_runs(const RemapTable& table, int from, int to, const T* image, std::size_t stride, T* output) {
    T* black = output + (from > 0 ? static_cast<std::ptrdiff_t>(table.runs[from - 1].end) * channels : 0);
    for (int r = from; r < to; ++r) {
        const Run& run = table.runs[r];
        T* pixel = output + static_cast<std::ptrdiff_t>(run.begin) * channels;
        std::fill(black, pixel, T(0));
        const Source* source = table.sources + run.first;
        for (int i = run.begin; i < run.end; ++i, ++source, pixel += channels) {
            const T* upper = image + source->y * stride + source->x * channels;
            blend_pixel<T, channels>(upper, upper + stride, *source, pixel);
        }
        black = pixel;
    }
    if (to == table.run_count)
        std::fill(black, output + static_cast<std::ptrdiff_t>(table.pixel_count) * channels, T(0));
}

template void remap_runs<std::uint8_t, 1>(const RemapTable&, int, int, const std::uint8_t*, std::size_t,
                                          std::uint8_t*);
template void remap_runs<std::uint8_t, 3>(const RemapTable&, int, int, const std::uint8_t*, std::size_t,
                                          std::uint8_t*);
template void remap_runs<std::uint16_t, 1>(const RemapTable&, int, int, const std::uint16_t*, std::size_t,
                                           std::uint16_t*);
template void remap_runs<std::uint16_t, 3>(const RemapTable&, int, int, const std::uint16_t*, std::size_t,
                                           std::uint16_t*);
template void remap_runs<float, 1>(const RemapTable&, int, int, const float*, std::size_t, float*);
template void remap_runs<float, 3>(const RemapTable&, int, int, const float*, std::size_t, float*);

}  // namespace facetcam
