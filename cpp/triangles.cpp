#include "triangles.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.hpp"
#include "sampling.hpp"

namespace facetcam {
namespace {

constexpr std::size_t kRaysPerTask = 4096;
constexpr float kMostSlanted = 0.05f;  // cosine from which on the texture is not blurred further
constexpr std::uint32_t kNone = ~0u;

// RTCRayHit of Embree 4, with room for the fields behind the hit that differ between builds.
struct alignas(16) RayHit {
    Vec3 origin;
    float near;
    Vec3 direction;
    float time, far;
    std::uint32_t mask, id, flags;
    Vec3 normal;
    float u, v;
    std::uint32_t primitive, geometry, instance[9];
};

template <class Work>
void for_each_ray(std::size_t count, int threads, const Work& work) {
    parallel_for(static_cast<int>((count + kRaysPerTask - 1) / kRaysPerTask), threads, [&](int task) {
        const std::size_t first = task * kRaysPerTask;
        for (std::size_t i = first; i < std::min(count, first + kRaysPerTask); ++i) work(i);
    });
}

Hit nearest(Intersect intersect, void* scene, Vec3 origin, Vec3 direction) {
    RayHit ray = {};
    ray.origin = origin;
    ray.direction = direction;
    ray.far = std::numeric_limits<float>::infinity();
    ray.mask = ray.primitive = ray.geometry = kNone;
    std::fill(std::begin(ray.instance), std::end(ray.instance), kNone);
    intersect(scene, &ray, nullptr);
    if (ray.geometry == kNone) return {};
    return {static_cast<std::int32_t>(ray.primitive), ray.far, ray.u, ray.v};
}

// Linear interpolation on the triangular lattice; row j holds steps + 1 - j places.
Vec3 lattice_light(const TriangleScene& scene, const Triangle& t, float u, float v, int side) {
    const auto at = [&](int i, int j) -> Vec3 {
        const int corner = i ? 1 : j ? 2 : 0;
        const std::size_t index = t.steps == 1
                                      ? t.corner[corner]
                                      : t.lattice + std::size_t(j) * (t.steps + 1) - j * (j - 1) / 2 + i;
        const float* light = scene.light[index][side];
        return {light[0], light[1], light[2]};
    };
    const float x = std::clamp(u, 0.0f, 1.0f) * t.steps, y = std::clamp(v, 0.0f, 1.0f) * t.steps;
    const int i = std::min(static_cast<int>(x), t.steps - 1);
    const int j = std::min(static_cast<int>(y), t.steps - 1 - i);
    const float ax = x - i, ay = y - j;
    if (ax + ay <= 1.0f || i + j + 2 > t.steps)
        return at(i, j) * (1.0f - ax - ay) + at(i + 1, j) * ax + at(i, j + 1) * ay;
    return at(i + 1, j + 1) * (ax + ay - 1.0f) + at(i, j + 1) * (1.0f - ax) + at(i + 1, j) * (1.0f - ay);
}

Vec3 tint(const TriangleScene& scene, const Triangle& t, float w, float u, float v) {
    const auto at = [&](int corner) -> Vec3 {
        const std::uint8_t* c = scene.tints[t.corner[corner]];
        return {value(c[0]), value(c[1]), value(c[2])};
    };
    return at(0) * w + at(1) * u + at(2) * v;
}

Vec3 seen(const TriangleScene& scene, const Hit& hit, Vec3 direction, float distance, float ray_angle) {
    const Triangle& t = scene.triangles[hit.surface];
    const Material& m = scene.materials[t.material];
    const float slope = dot(direction, t.normal);
    // The footprint of a ray is an ellipse; its mean radius balances blur against aliasing.
    const float footprint = distance * ray_angle / std::sqrt(std::max(std::abs(slope), kMostSlanted));
    const float w = 1.0f - hit.u - hit.v;
    const float *a = scene.uv[t.corner[0]], *b = scene.uv[t.corner[1]], *c = scene.uv[t.corner[2]];
    const float x = w * a[0] + hit.u * b[0] + hit.v * c[0], y = w * a[1] + hit.u * b[1] + hit.v * c[1];
    const auto picture = [&](const Texture& texture) {
        const float texels = footprint * t.density * texture.width / m.texture.width;
        return trilinear<true>(scene.texels, texture, texels, x - std::floor(x), y - std::floor(y));
    };
    Vec3 paint = picture(m.texture) * Vec3{m.colour[0], m.colour[1], m.colour[2]};
    if (scene.tints) paint = paint * tint(scene, t, w, hit.u, hit.v);
    const Vec3 light = paint * lattice_light(scene, t, hit.u, hit.v, slope < 0.0f ? 0 : 1);
    return m.glow > 0.0f ? light + picture(m.glow_texture) * m.glow : light;
}

}  // namespace

void cast_triangles(const TriangleTree& tree, const Vec3* origins, const Vec3* directions,
                    std::size_t ray_count, int threads, Hit* hits) {
    for_each_ray(ray_count, threads,
                 [&](std::size_t i) { hits[i] = tree.nearest(origins[i], directions[i]); });
}

void cast_triangles(Intersect intersect, void* scene, const Vec3* origins, const Vec3* directions,
                    std::size_t ray_count, int threads, Hit* hits) {
    for_each_ray(ray_count, threads,
                 [&](std::size_t i) { hits[i] = nearest(intersect, scene, origins[i], directions[i]); });
}

void shade_triangles(const TriangleScene& scene, const Vec3* directions, const float* travelled,
                     const Hit* hits, std::size_t ray_count, float ray_angle, int threads,
                     float (*radiance)[3]) {
    for_each_ray(ray_count, threads, [&](std::size_t i) {
        const Hit& hit = hits[i];
        Vec3 light = {0.0f, 0.0f, 0.0f};
        if (hit.surface >= 0) light = seen(scene, hit, directions[i], travelled[i] + hit.distance, ray_angle);
        radiance[i][0] = light.x;
        radiance[i][1] = light.y;
        radiance[i][2] = light.z;
    });
}

}  // namespace facetcam
