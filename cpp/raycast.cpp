#include "raycast.hpp"

#include <cmath>

#include "parallel.hpp"

namespace facetcam {
namespace {

constexpr std::size_t kRaysPerTask = 4096;
constexpr float kMostSlanted = 0.05f;  // cosine from which on the texture is not blurred further

template <class Work>
void for_each_ray(std::size_t count, int threads, const Work& work) {
    parallel_for(static_cast<int>((count + kRaysPerTask - 1) / kRaysPerTask), threads, [&](int task) {
        const std::size_t first = task * kRaysPerTask;
        for (std::size_t i = first; i < std::min(count, first + kRaysPerTask); ++i) work(i);
    });
}

float value(float irradiance) { return irradiance; }
float value(std::uint8_t texel) { return static_cast<float>(texel * texel) * (1.0f / (255.0f * 255.0f)); }

// Bilinear sample; texel centres lie at (i + 0.5) / size, the border is repeated.
template <class Texel>
Vec3 bilinear(const Texel (*texels)[3], const Texture& texture, float u, float v) {
    const int width = texture.width, height = texture.height;
    const float x = std::clamp(u * width - 0.5f, 0.0f, width - 1.0f);
    const float y = std::clamp(v * height - 0.5f, 0.0f, height - 1.0f);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
    const float ax = x - x0, ay = y - y0;
    const auto texel = [&](int column, int row) -> Vec3 {
        const Texel* t = texels[texture.offset + static_cast<std::size_t>(row) * width + column];
        return {value(t[0]), value(t[1]), value(t[2])};
    };
    const Vec3 top = texel(x0, y0) * (1.0f - ax) + texel(x1, y0) * ax;
    const Vec3 bottom = texel(x0, y1) * (1.0f - ax) + texel(x1, y1) * ax;
    return top * (1.0f - ay) + bottom * ay;
}

Texture halved(const Texture& t) {
    return {t.offset + t.width * t.height, std::max(1, t.width / 2), std::max(1, t.height / 2), t.levels - 1};
}

// Reflectance between the two levels of the mip map whose texels are next to `footprint` (in texels).
Vec3 trilinear(const std::uint8_t (*texels)[3], Texture texture, float footprint, float u, float v) {
    float level = std::clamp(std::log2(footprint), 0.0f, texture.levels - 1.0f);
    for (; level >= 1.0f; level -= 1.0f) texture = halved(texture);
    const Vec3 fine = bilinear(texels, texture, u, v);
    return level > 0.0f ? fine * (1.0f - level) + bilinear(texels, halved(texture), u, v) * level : fine;
}

}  // namespace

void cast(const RectangleTree& tree, const Vec3* origins, int origin_step, const Vec3* directions,
          std::size_t ray_count, int threads, Hit* hits) {
    for_each_ray(ray_count, threads,
                 [&](std::size_t i) { hits[i] = tree.nearest(origins[i * origin_step], directions[i]); });
}

void shade(const Rectangle* rectangles, const Paint& paint, const Vec3* directions, const Hit* hits,
           std::size_t ray_count, float ray_angle, int threads, float (*radiance)[3]) {
    for_each_ray(ray_count, threads, [&](std::size_t i) {
        const Hit& hit = hits[i];
        Vec3 light = {0.0f, 0.0f, 0.0f};
        if (hit.surface >= 0) {
            const Rectangle& r = rectangles[hit.surface];
            const Texture& texture = paint.textures[hit.surface];
            const float slant = std::abs(dot(directions[i], cross(r.down, r.right)));
            // The footprint of a ray is an ellipse; its mean radius balances blur against aliasing.
            const float footprint = hit.distance * ray_angle / std::sqrt(std::max(slant, kMostSlanted));
            const float texels = footprint * texture.width / r.width;
            light = trilinear(paint.texels, texture, texels, hit.u, hit.v) *
                    bilinear(paint.light, paint.light_maps[hit.surface], hit.u, hit.v);
        }
        radiance[i][0] = light.x;
        radiance[i][1] = light.y;
        radiance[i][2] = light.z;
    });
}

}  // namespace facetcam
