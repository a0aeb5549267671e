#include "remap.hpp"

#include <algorithm>

namespace facetcam {

namespace {

constexpr int kOne = 1 << kFractionBits;

inline std::uint8_t blend(std::uint8_t a, std::uint8_t b, std::uint8_t c, std::uint8_t d, int right,
                          int down) {
    const int upper = a * kOne + (b - a) * right, lower = c * kOne + (d - c) * right;
    return static_cast<std::uint8_t>(
        (upper * kOne + (lower - upper) * down + (1 << (2 * kFractionBits - 1))) >> (2 * kFractionBits));
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
            const T* lower = upper + stride;
            for (int c = 0; c < channels; ++c)
                pixel[c] = blend(upper[c], upper[c + channels], lower[c], lower[c + channels], source->right,
                                 source->down);
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
