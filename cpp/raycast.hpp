// What rays see among textured rectangles: the nearest one, and the light that comes back from it.
#pragma once
#include <cstddef>
#include <cstdint>

#include "rectangle_tree.hpp"

namespace facetcam {

// Where a picture lies among the texels; the halved copies of a mip map follow it.
struct Texture {
    std::int32_t offset, width, height, levels;
};

struct Paint {
    const std::uint8_t (*texels)[3];  // square roots of the reflectance, 0 to 255
    const Texture* textures;          // one a rectangle
    const float (*light)[3];          // irradiance that meets the surface
    const Texture* light_maps;        // one a rectangle, one level each
};

// `origin_step` is 0 where all rays start at origins[0], else 1.
void cast(const RectangleTree& tree, const Vec3* origins, int origin_step, const Vec3* directions,
          std::size_t ray_count, int threads, Hit* hits);

// `ray_angle` is the angle between neighbouring rays; it chooses the level of the mip map.
void shade(const Rectangle* rectangles, const Paint& paint, const Vec3* directions, const Hit* hits,
           std::size_t ray_count, float ray_angle, int threads, float (*radiance)[3]);

}  // namespace facetcam
