// Python border of resampling.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstdint>

#include "bindings.hpp"
#include "parallel.hpp"
#include "remap.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace facetcam {

namespace {

using Sources = nb::ndarray<const std::uint16_t, nb::shape<-1, 4>, nb::c_contig, nb::device::cpu>;
using Runs = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <class T>
using Image = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <class T>
using Pictures = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr int kTaskRuns = 64;

template <class T>
void remap(const Sources& sources, const Runs& runs, const Image<const T>& image, const Pictures<T>& output,
           int threads) {
    const RemapTable table{reinterpret_cast<const Source*>(sources.data()),
                           reinterpret_cast<const Run*>(runs.data()), static_cast<int>(runs.shape(0)),
                           static_cast<std::int32_t>(output.shape(0))};
    const std::size_t channels = image.shape(2), stride = image.shape(1) * channels;
    if (output.shape(1) != channels || (channels != 1 && channels != 3))
        throw nb::value_error("remap: image and output take one or three channels, the same");
    nb::gil_scoped_release release;
    auto* fill = channels == 1 ? &remap_runs<T, 1> : &remap_runs<T, 3>;
    const int tasks = std::max(1, (table.run_count + kTaskRuns - 1) / kTaskRuns);
    parallel_for(tasks, threads, [&](int task) {
        const int from = task * kTaskRuns, to = std::min(from + kTaskRuns, table.run_count);
        fill(table, from, to, image.data(), stride, output.data());
    });
}

template <class T>
void define(nb::module_& m) {
    m.def("remap", &remap<T>, "sources"_a.noconvert(), "runs"_a.noconvert(), "image"_a.noconvert(),
          "output"_a.noconvert(), "threads"_a);
}

}  // namespace

void bind_remap(nb::module_& m) {
    define<std::uint8_t>(m);
    define<std::uint16_t>(m);
    define<float>(m);
}

}  // namespace facetcam
