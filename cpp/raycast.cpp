#include "raycast.hpp"

#include <cmath>

#include "parallel.hpp"
#include "sampling.hpp"

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
