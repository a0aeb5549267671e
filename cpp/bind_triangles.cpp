// Python border of triangle scenes: checks that tables belong together, releases the GIL.
#include <algorithm>
#include <stdexcept>

#include "bindings.hpp"
#include "triangles.hpp"

namespace nb = nanobind;

namespace facetcam {
namespace {

template <class T, int Columns>
using Table = nb::ndarray<const T, nb::shape<-1, Columns>, nb::c_contig, nb::device::cpu>;
template <class Row>
using Rows = Table<std::uint8_t, sizeof(Row)>;
using Corners = Table<std::int32_t, 3>;
using Travelled = nb::ndarray<const float, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Light = nb::ndarray<const float, nb::shape<-1, 2, 3>, nb::c_contig, nb::device::cpu>;
using HitRows = nb::ndarray<nb::numpy, std::uint8_t, nb::ndim<2>>;
using Radiance = nb::ndarray<nb::numpy, float, nb::ndim<2>>;

static_assert(sizeof(Vec3) == 3 * sizeof(float) && sizeof(Hit) == 4 * sizeof(float));
static_assert(sizeof(Triangle) == 40 && sizeof(Material) == 48);

template <class Row, class Array>
const Row* rows(const Array& table) {
    return reinterpret_cast<const Row*>(table.data());
}

// Calls `cast` with origins, directions, their number and the place of the hits, without Python's lock.
template <class Cast>
auto cast_rays(Table<float, 3> origins, Table<float, 3> directions, const Cast& cast) {
    const std::size_t count = directions.shape(0);
    if (origins.shape(0) != count) throw std::invalid_argument("origins: expected one for each direction");
    std::vector<std::uint8_t> hits(count * sizeof(Hit));
    {
        nb::gil_scoped_release release;
        cast(rows<Vec3>(origins), rows<Vec3>(directions), count, reinterpret_cast<Hit*>(hits.data()));
    }
    return to_numpy<HitRows>(std::move(hits), {count, sizeof(Hit)});
}

auto cast_by_embree(std::uintptr_t intersect, std::uintptr_t scene, Table<float, 3> origins,
                    Table<float, 3> directions, int threads) {
    if (!intersect || !scene) throw std::invalid_argument("intersect, scene: expected Embree's addresses");
    return cast_rays(origins, directions,
                     [=](const Vec3* from, const Vec3* to, std::size_t count, Hit* hits) {
                         cast_triangles(reinterpret_cast<Intersect>(intersect),
                                        reinterpret_cast<void*>(scene), from, to, count, threads, hits);
                     });
}

auto cast_by_tree(const TriangleTree& tree, Table<float, 3> origins, Table<float, 3> directions,
                  int threads) {
    return cast_rays(origins, directions,
                     [&](const Vec3* from, const Vec3* to, std::size_t count, Hit* hits) {
                         cast_triangles(tree, from, to, count, threads, hits);
                     });
}

void make_tree(TriangleTree* self, Table<float, 3> vertices, Corners corners) {
    const auto known = static_cast<std::int32_t>(vertices.shape(0));
    const std::int32_t* corner = corners.data();
    if (std::any_of(corner, corner + corners.size(), [=](std::int32_t c) { return c < 0 || c >= known; }))
        throw std::invalid_argument("faces: a corner that is not there");
    new (self) TriangleTree(rows<Vec3>(vertices), reinterpret_cast<const std::int32_t (*)[3]>(corner),
                            corners.shape(0));
}

bool fits(const Texture& t, std::size_t texels) {
    std::size_t end = t.offset;
    for (int level = 0; level < t.levels; ++level)
        end += static_cast<std::size_t>(std::max(1, t.width >> level)) * std::max(1, t.height >> level);
    return t.offset >= 0 && t.width > 0 && t.height > 0 && t.levels > 0 && end <= texels;
}

// A scene whose tables were found to belong together once, for all frames.
class TriangleShader {
 public:
    TriangleShader(Rows<Triangle> triangles, Table<float, 2> uv, Rows<Material> materials,
                   Table<std::uint8_t, 3> texels, Table<std::uint8_t, 3> tints, std::size_t places)
        : triangles_(rows<Triangle>(triangles), rows<Triangle>(triangles) + triangles.shape(0)),
          uv_(uv.data(), uv.data() + uv.size()),
          materials_(rows<Material>(materials), rows<Material>(materials) + materials.shape(0)),
          texels_(texels),
          tints_(tints),
          places_(places) {
        for (const Material& m : materials_)
            if (!fits(m.texture, texels.shape(0)) || !fits(m.glow_texture, texels.shape(0)))
                throw std::invalid_argument("materials: a texture leaves the texels");
        if (tints.shape(0) != 0 && tints.shape(0) != uv.shape(0))
            throw std::invalid_argument("tints: expected one for each corner, or none");
        const int corners = static_cast<int>(uv.shape(0)), kinds = static_cast<int>(materials_.size());
        for (const Triangle& t : triangles_) {
            const std::size_t steps = t.steps;
            const bool lit = t.steps == 1 ? std::size_t(corners) <= places
                                          : t.steps > 1 && t.lattice >= 0 &&
                                                t.lattice + (steps + 1) * (steps + 2) / 2 <= places;
            if (!lit || t.material < 0 || t.material >= kinds ||
                std::any_of(t.corner, t.corner + 3, [&](int c) { return c < 0 || c >= corners; }))
                throw std::invalid_argument("triangles: a corner, material or place of light is missing");
        }
    }

    auto shade(Light light, Table<float, 3> directions, Travelled travelled, Rows<Hit> hits, float ray_angle,
               int threads) const {
        const std::size_t count = directions.shape(0);
        if (hits.shape(0) != count || travelled.shape(0) != count)
            throw std::invalid_argument("hits, travelled: expected one for each direction");
        if (light.shape(0) != places_) throw std::invalid_argument("light: expected one a place");
        const auto* hit = rows<Hit>(hits);
        const int known = static_cast<int>(triangles_.size());
        if (std::any_of(hit, hit + count, [&](const Hit& h) { return h.surface >= known; }))
            throw std::invalid_argument("hits: a surface that is not in the scene");
        const TriangleScene scene = {triangles_.data(),
                                     reinterpret_cast<const float (*)[2]>(uv_.data()),
                                     materials_.data(),
                                     rows<std::uint8_t[3]>(texels_),
                                     tints_.shape(0) ? rows<std::uint8_t[3]>(tints_) : nullptr,
                                     reinterpret_cast<const float (*)[2][3]>(light.data())};
        std::vector<float> radiance(3 * count);
        {
            nb::gil_scoped_release release;
            shade_triangles(scene, rows<Vec3>(directions), travelled.data(), hit, count, ray_angle, threads,
                            reinterpret_cast<float (*)[3]>(radiance.data()));
        }
        return to_numpy<Radiance>(std::move(radiance), {count, 3});
    }

 private:
    std::vector<Triangle> triangles_;
    std::vector<float> uv_;
    std::vector<Material> materials_;
    Table<std::uint8_t, 3> texels_, tints_;
    std::size_t places_;
};

}  // namespace

void bind_triangles(nb::module_& m) {
    using namespace nb::literals;
    nb::class_<TriangleTree>(m, "TriangleTree")
        .def("__init__", &make_tree, "vertices"_a.noconvert(), "faces"_a.noconvert())
        .def("cast", &cast_by_tree, "origins"_a.noconvert(), "directions"_a.noconvert(), "threads"_a);
    m.def("cast_by_embree", &cast_by_embree, "intersect"_a, "scene"_a, "origins"_a.noconvert(),
          "directions"_a.noconvert(), "threads"_a);
    nb::class_<TriangleShader>(m, "TriangleShader")
        .def(nb::init<Rows<Triangle>, Table<float, 2>, Rows<Material>, Table<std::uint8_t, 3>,
                      Table<std::uint8_t, 3>, std::size_t>(),
             "triangles"_a.noconvert(), "uv"_a.noconvert(), "materials"_a.noconvert(), "texels"_a.noconvert(),
             "tints"_a.noconvert(), "places"_a)
        .def("shade", &TriangleShader::shade, "light"_a.noconvert(), "directions"_a.noconvert(),
             "travelled"_a.noconvert(), "hits"_a.noconvert(), "ray_angle"_a, "threads"_a);
}

}  // namespace facetcam
