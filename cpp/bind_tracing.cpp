// Python border of the lens models and of ray tracing through mirrors.
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <thread>
#include <vector>

#include "bindings.hpp"
#include "lens.hpp"
#include "parallel.hpp"
#include "tracing.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace facetcam {

namespace {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Rows4 = nb::ndarray<const double, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Starts = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Pixels = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;

using Doubles = nb::ndarray<nb::numpy, double, nb::ndim<2>>;
using Bytes = nb::ndarray<nb::numpy, std::int8_t, nb::ndim<2>>;
using Flags = nb::ndarray<nb::numpy, bool, nb::ndim<1>>;

constexpr int kBlock = 8192;  // rays a task: smaller sets are not worth a thread

// Calls work(begin, end) on blocks of [0, count) with the GIL released.
template <class Work>
void in_blocks(std::size_t count, const Work& work) {
    nb::gil_scoped_release release;
    const int blocks = static_cast<int>((count + kBlock - 1) / kBlock);
    parallel_for(blocks, static_cast<int>(std::thread::hardware_concurrency()), [&](int b) {
        const std::size_t begin = static_cast<std::size_t>(b) * kBlock;
        work(begin, std::min(count, begin + kBlock));
    });
}

auto project(const Lens& lens, Points points) {
    const std::size_t count = points.shape(0);
    std::vector<double> pixels(2 * count);
    std::vector<std::uint8_t> valid(count);
    in_blocks(count, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            double* pixel = pixels.data() + 2 * i;
            valid[i] = lens.project(points.data() + 3 * i, pixel);
            if (!valid[i]) pixel[0] = pixel[1] = 0;
        }
    });
    return std::make_pair(to_numpy<Doubles>(std::move(pixels), {count, 2}),
                          to_numpy<Flags>(std::move(valid), {count}));
}

auto rays(const Lens& lens, Pixels pixels) {
    const std::size_t count = pixels.shape(0);
    std::vector<double> directions(3 * count);
    in_blocks(count, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) lens.ray(pixels.data() + 2 * i, directions.data() + 3 * i);
    });
    return to_numpy<Doubles>(std::move(directions), {count, 3});
}

// Mirrors from planes (M, 4), thickness and index of their glass (M, 2), and the half spaces of mirror m,
// rows starts[m] to starts[m + 1].
std::vector<FlatMirror> flat_mirrors(const Rows4& planes, const Pixels& glass, const Rows4& bounds,
                                     const Starts& starts) {
    std::vector<FlatMirror> mirrors;
    for (std::size_t m = 0; m < planes.shape(0); ++m) {
        const double* p = planes.data() + 4 * m;
        const double* g = glass.data() + 2 * m;
        const int first = starts.data()[m];
        mirrors.push_back(
            {{p[0], p[1], p[2]}, p[3], g[0], g[1], bounds.data() + 4 * first, starts.data()[m + 1] - first});
    }
    return mirrors;
}

auto trace_rays(Rows4 planes, Pixels glass, Rows4 bounds, Starts starts, Points directions,
                std::size_t bounces) {
    const std::size_t count = directions.shape(0);
    const auto mirrors = flat_mirrors(planes, glass, bounds, starts);
    std::vector<std::int8_t> sequence(bounces * count);
    std::vector<double> length(bounces * count);
    in_blocks(count, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            trace(mirrors, directions.data() + 3 * i, static_cast<int>(bounces), count, sequence.data() + i,
                  length.data() + i);
    });
    return std::make_pair(to_numpy<Bytes>(std::move(sequence), {bounces, count}),
                          to_numpy<Doubles>(std::move(length), {bounces, count}));
}

}  // namespace

void bind_tracing(nb::module_& m) {
    nb::class_<Lens>(m, "Lens")
        .def(
            "__init__",
            [](Lens* self, bool kannala_brandt, std::array<double, 2> size, std::array<double, 4> intrinsics,
               std::array<double, 4> radial, std::array<double, 2> tangential, double limit) {
                const auto& [fx, fy, cx, cy] = intrinsics;
                new (self) Lens{kannala_brandt,
                                size[0],
                                size[1],
                                fx,
                                fy,
                                cx,
                                cy,
                                {radial[0], radial[1], radial[2], radial[3]},
                                {tangential[0], tangential[1]},
                                limit};
            },
            "kannala_brandt"_a, "size"_a, "intrinsics"_a, "radial"_a, "tangential"_a, "limit"_a)
        .def("project", &project, "points"_a.noconvert())
        .def("rays", &rays, "pixels"_a.noconvert());
    m.def("trace_rays", &trace_rays, "planes"_a.noconvert(), "glass"_a.noconvert(), "bounds"_a.noconvert(),
          "starts"_a.noconvert(), "directions"_a.noconvert(), "bounces"_a);
}

}  // namespace facetcam
