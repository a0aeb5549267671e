// What rays see among textured triangles: Embree or a tree of our own finds the nearest one, and the light
// that comes back from it is ours.
#pragma once
#include <cstddef>
#include <cstdint>

#include "texture.hpp"
#include "triangle_tree.hpp"

namespace facetcam {

// Embree's `rtcIntersect1`, which the caller loaded: (scene, RTCRayHit, arguments).
using Intersect = void (*)(void*, void*, void*);

// `density` is in texels a metre on the finest level. Light is known on a lattice of `steps` steps along each
// edge, stored from `lattice` on, row by row; with one step at the corners, which neighbours share.
struct Triangle {
    std::int32_t corner[3];
    Vec3 normal;  // unit, as the corners turn
    float density;
    std::int32_t material, lattice, steps;
};

struct Material {
    Texture texture;
    float colour[3];  // reflectance times the texture's
    float glow;       // light of its own, times that of `glow_texture`; in units of irradiance
    Texture glow_texture;
};

struct TriangleScene {
    const Triangle* triangles;
    const float (*uv)[2];  // one a corner; the picture repeats
    const Material* materials;
    const std::uint8_t (*texels)[3];
    const std::uint8_t (*tints)[3];  // one a corner, as texels: its reflectance times the picture's; or null
    const float (*light)[2][3];      // irradiance of a place on the side of the normal, and on the other
};

// Origins and directions are (N, 3), unit directions; `surface` of a hit is the triangle, u and v its place.
void cast_triangles(const TriangleTree& tree, const Vec3* origins, const Vec3* directions,
                    std::size_t ray_count, int threads, Hit* hits);
void cast_triangles(Intersect intersect, void* scene, const Vec3* origins, const Vec3* directions,
                    std::size_t ray_count, int threads, Hit* hits);

// `travelled` is the way of each ray before its origin, in metres; `ray_angle` is the angle between
// neighbouring rays; it chooses the level of the mip map.
void shade_triangles(const TriangleScene& scene, const Vec3* directions, const float* travelled,
                     const Hit* hits, std::size_t ray_count, float ray_angle, int threads,
                     float (*radiance)[3]);

}  // namespace facetcam
