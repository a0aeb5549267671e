// Samples of pictures: bilinear within a level of the mip map, linear between levels.
#pragma once
#include <algorithm>
#include <cmath>

#include "texture.hpp"
#include "vec3.hpp"

namespace facetcam {

inline float value(float irradiance) { return irradiance; }
inline float value(std::uint8_t texel) {
    return static_cast<float>(texel * texel) * (1.0f / (255.0f * 255.0f));
}

// Two neighbouring texels and the share of the higher one.
struct Between {
    int low, high;
    float share;
};

template <bool tiled>
Between between(float place, int size) {
    float x = place * size - 0.5f;
    if (!tiled) x = std::clamp(x, 0.0f, size - 1.0f);
    const int low = static_cast<int>(std::floor(x));
    const float share = x - low;
    if (tiled) return {low < 0 ? size - 1 : std::min(low, size - 1), low + 1 >= size ? 0 : low + 1, share};
    return {low, std::min(low + 1, size - 1), share};
}

// Bilinear sample; texel centres lie at (i + 0.5) / size. Beyond the border it repeats, or the picture does.
template <bool tiled = false, class Texel>
Vec3 bilinear(const Texel (*texels)[3], const Texture& texture, float u, float v) {
    const int width = texture.width, height = texture.height;
    const Between x = between<tiled>(u, width), y = between<tiled>(v, height);
    const auto texel = [&](int column, int row) -> Vec3 {
        const Texel* t = texels[texture.offset + static_cast<std::size_t>(row) * width + column];
        return {value(t[0]), value(t[1]), value(t[2])};
    };
    const Vec3 top = texel(x.low, y.low) * (1.0f - x.share) + texel(x.high, y.low) * x.share;
    const Vec3 bottom = texel(x.low, y.high) * (1.0f - x.share) + texel(x.high, y.high) * x.share;
    return top * (1.0f - y.share) + bottom * y.share;
}

inline Texture halved(const Texture& t) {
    return {t.offset + t.width * t.height, std::max(1, t.width / 2), std::max(1, t.height / 2), t.levels - 1};
}

// Reflectance between the two levels of the mip map whose texels are next to `footprint` (in texels).
template <bool tiled = false>
Vec3 trilinear(const std::uint8_t (*texels)[3], Texture texture, float footprint, float u, float v) {
    float level = std::clamp(std::log2(footprint), 0.0f, texture.levels - 1.0f);
    for (; level >= 1.0f; level -= 1.0f) texture = halved(texture);
    const Vec3 fine = bilinear<tiled>(texels, texture, u, v);
    return level > 0.0f ? fine * (1.0f - level) + bilinear<tiled>(texels, halved(texture), u, v) * level
                        : fine;
}

}  // namespace facetcam
