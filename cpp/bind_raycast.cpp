// Python border of the ray caster: checks that tables belong together, releases the GIL.
#include <algorithm>
#include <stdexcept>

#include "bindings.hpp"
#include "raycast.hpp"

namespace nb = nanobind;

namespace facetcam {
namespace {

template <class T, int Columns>
using Table = nb::ndarray<const T, nb::shape<-1, Columns>, nb::c_contig, nb::device::cpu>;
using Rectangles = Table<float, 11>;
using Textures = Table<std::int32_t, 4>;
using HitRows = nb::ndarray<nb::numpy, std::uint8_t, nb::ndim<2>>;
using Radiance = nb::ndarray<nb::numpy, float, nb::ndim<2>>;

static_assert(sizeof(Vec3) == 3 * sizeof(float) && sizeof(Rectangle) == 11 * sizeof(float));
static_assert(sizeof(Hit) == 4 * sizeof(float) && sizeof(Texture) == 4 * sizeof(std::int32_t));

template <class Row, class Array>
const Row* rows(const Array& table) {
    return reinterpret_cast<const Row*>(table.data());
}

auto cast_rays(const RectangleTree& tree, Table<float, 3> origins, Table<float, 3> directions, int threads) {
    const std::size_t count = directions.shape(0);
    if (origins.shape(0) != 1 && origins.shape(0) != count)
        throw std::invalid_argument("origins: expected one, or one for each direction");
    std::vector<std::uint8_t> hits(count * sizeof(Hit));
    {
        nb::gil_scoped_release release;
        cast(tree, rows<Vec3>(origins), origins.shape(0) == 1 ? 0 : 1, rows<Vec3>(directions), count, threads,
             reinterpret_cast<Hit*>(hits.data()));
    }
    return to_numpy<HitRows>(std::move(hits), {count, sizeof(Hit)});
}

// Kernels trust their tables, so a wrong one must stop here.
void check_textures(const Textures& table, std::size_t rectangles, std::size_t texels, const char* message) {
    bool fits = table.shape(0) == rectangles;
    for (std::size_t i = 0; fits && i < rectangles; ++i) {
        const Texture& t = rows<Texture>(table)[i];
        std::size_t end = t.offset;
        for (int level = 0; level < t.levels; ++level)
            end += static_cast<std::size_t>(std::max(1, t.width >> level)) * std::max(1, t.height >> level);
        fits = t.offset >= 0 && t.width > 0 && t.height > 0 && t.levels > 0 && end <= texels;
    }
    if (!fits) throw std::invalid_argument(message);
}

auto shade_rays(Rectangles rectangles, Table<std::uint8_t, 3> texels, Textures textures,
                Table<float, 3> light, Textures light_maps, Table<float, 3> directions,
                Table<std::uint8_t, sizeof(Hit)> hits, float ray_angle, int threads) {
    const std::size_t count = directions.shape(0);
    if (hits.shape(0) != count) throw std::invalid_argument("hits: expected one for each direction");
    check_textures(textures, rectangles.shape(0), texels.shape(0), "textures: one leaves the texels");
    check_textures(light_maps, rectangles.shape(0), light.shape(0),
                   "light_maps: one leaves the light texels");
    const auto* hit = rows<Hit>(hits);
    if (std::any_of(hit, hit + count, [&](const Hit& h) { return h.surface >= int(rectangles.shape(0)); }))
        throw std::invalid_argument("hits: a surface that is not in the scene");
    const Paint paint = {reinterpret_cast<const std::uint8_t (*)[3]>(texels.data()), rows<Texture>(textures),
                         reinterpret_cast<const float (*)[3]>(light.data()), rows<Texture>(light_maps)};
    std::vector<float> radiance(3 * count);
    {
        nb::gil_scoped_release release;
        shade(rows<Rectangle>(rectangles), paint, rows<Vec3>(directions), hit, count, ray_angle, threads,
              reinterpret_cast<float (*)[3]>(radiance.data()));
    }
    return to_numpy<Radiance>(std::move(radiance), {count, 3});
}

}  // namespace

void bind_raycast(nb::module_& m) {
    using namespace nb::literals;
    nb::class_<RectangleTree>(m, "RectangleTree")
        .def(
            "__init__",
            [](RectangleTree* self, Rectangles r) {
                new (self) RectangleTree(rows<Rectangle>(r), r.shape(0));
            },
            "rectangles"_a.noconvert())
        .def("cast", &cast_rays, "origins"_a.noconvert(), "directions"_a.noconvert(), "threads"_a);
    m.def("shade_rays", &shade_rays, "rectangles"_a.noconvert(), "texels"_a.noconvert(),
          "textures"_a.noconvert(), "light"_a.noconvert(), "light_maps"_a.noconvert(),
          "directions"_a.noconvert(), "hits"_a.noconvert(), "ray_angle"_a, "threads"_a);
}

}  // namespace facetcam
