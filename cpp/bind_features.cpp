// Python border of corners and matching: array types are exact, the GIL is released while kernels run.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <algorithm>

#include "bindings.hpp"
#include "corners.hpp"
#include "matching.hpp"

namespace nb = nanobind;

namespace facetcam {
namespace {

using Image = nb::ndarray<nb::ro, nb::ndim<2>, nb::device::cpu>;
using Mask = nb::ndarray<const std::uint8_t, nb::ndim<2>, nb::device::cpu>;
using Bytes = nb::ndarray<const std::uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Points = nb::ndarray<const float, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using Indices = nb::ndarray<const std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const std::int16_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

using KeypointRows = nb::ndarray<nb::numpy, float, nb::shape<-1, 6>>;
using TableOut = nb::ndarray<nb::numpy, std::int16_t, nb::ndim<1>>;
using DistancesOut = nb::ndarray<nb::numpy, std::int32_t, nb::ndim<2>>;
using IndicesOut = nb::ndarray<nb::numpy, std::int32_t, nb::ndim<1>>;

ImageView view_of(const Image& image) {
    const auto item = static_cast<std::ptrdiff_t>(image.itemsize());
    const PixelType type = image.dtype() == nb::dtype<std::uint8_t>()    ? PixelType::u8
                           : image.dtype() == nb::dtype<std::uint16_t>() ? PixelType::u16
                                                                         : PixelType::values;
    return {image.data(),
            type,
            static_cast<int>(image.shape(1)),
            static_cast<int>(image.shape(0)),
            image.stride(0) * item,
            image.stride(1) * item};
}

MaskView view_of(const std::optional<Mask>& mask) {
    if (!mask) return {nullptr, 0, 0};
    return {mask->data(), mask->stride(0), mask->stride(1)};
}

KeypointRows detect(const Image& image, const std::optional<Mask>& mask, const Table& table, int scales,
                    float sigma, float window, float alpha, float compression, float coarse_weight,
                    float threshold, int suppression, int border, int max_features, int cell, bool oriented,
                    int threads, int isa) {
    const DetectorOptions options{scales,
                                  {sigma, window, alpha, compression, coarse_weight},
                                  {threshold, suppression, border},
                                  max_features,
                                  cell,
                                  oriented,
                                  threads,
                                  usable_isa(isa)};
    const std::vector<std::int16_t> transfer(table.data(), table.data() + table.size());
    std::vector<Keypoint> found;
    {
        nb::gil_scoped_release release;
        found = detect_corners(view_of(image), view_of(mask), transfer, options);
    }
    std::vector<float> rows;
    for (const Keypoint& k : found)
        rows.insert(rows.end(), {k.x, k.y, k.size, k.angle, k.response, static_cast<float>(k.level)});
    return to_numpy<KeypointRows>(std::move(rows), {found.size(), 6});
}

TableOut transfer_table(const Image& image, const std::optional<Mask>& mask, double eta,
                        std::optional<double> black) {
    std::vector<std::int16_t> table;
    {
        nb::gil_scoped_release release;
        const ImageView view = view_of(image);
        LightLevels light = measure_light(view, view_of(mask));
        light.black = std::min(black.value_or(light.black), light.median);
        table = log_table(view.type, light, eta);
    }
    const std::size_t n = table.size();
    return to_numpy<TableOut>(std::move(table), {n});
}

Descriptors descriptors_of(const Bytes& bytes) {
    return {bytes.data(), static_cast<int>(bytes.shape(0)), static_cast<int>(bytes.shape(1))};
}

DistancesOut hamming(const Bytes& query, const Bytes& train) {
    std::vector<std::int32_t> all;
    {
        nb::gil_scoped_release release;
        all = hamming_distances(descriptors_of(query), descriptors_of(train));
    }
    return to_numpy<DistancesOut>(std::move(all), {query.shape(0), train.shape(0)});
}

IndicesOut mutual(const Bytes& query, const Bytes& train, const Indices& group, int groups, int max_distance,
                  float ratio) {
    if (group.shape(0) != train.shape(0))
        throw nb::value_error("match_mutual: expected a group for each train descriptor");
    for (std::size_t t = 0; t < group.shape(0); ++t)
        if (group(t) < 0 || group(t) >= groups) throw nb::value_error("match_mutual: group out of range");
    std::vector<std::int32_t> matches;
    {
        nb::gil_scoped_release release;
        matches = match_mutual(descriptors_of(query), descriptors_of(train), group.data(), groups,
                               {max_distance, ratio});
    }
    return to_numpy<IndicesOut>(std::move(matches), {query.shape(0)});
}

IndicesOut windowed(const Bytes& query, const Points& query_xy, const Indices& query_view, const Bytes& train,
                    const Points& train_xy, const Indices& train_view, float radius, int max_distance,
                    float ratio) {
    std::vector<std::int32_t> matches;
    {
        nb::gil_scoped_release release;
        matches =
            match_windowed(descriptors_of(query), {query_xy.data(), query_view.data()}, descriptors_of(train),
                           {train_xy.data(), train_view.data()}, radius, {max_distance, ratio});
    }
    return to_numpy<IndicesOut>(std::move(matches), {query.shape(0)});
}

}  // namespace

void bind_features(nb::module_& m) {
    using namespace nb::literals;
    m.def("detect_corners", &detect, "image"_a.noconvert(), "mask"_a.noconvert().none(),
          "table"_a.noconvert(), "scales"_a, "sigma"_a, "window"_a, "alpha"_a, "compression"_a,
          "coarse_weight"_a, "threshold"_a, "suppression"_a, "border"_a, "max_features"_a, "cell"_a,
          "oriented"_a, "threads"_a, "isa"_a = -1,
          "Robust corners as rows (x, y, size, angle, response, level), strongest first.");
    m.def("transfer_table", &transfer_table, "image"_a.noconvert(), "mask"_a.noconvert().none(), "eta"_a,
          "black"_a = nb::none(),
          "Light-compensating logarithm for every grey value of an 8 or 16 bit image.");
    m.def(
        "best_isa", [] { return static_cast<int>(best_isa()); },
        "Best instruction set of this machine: 0 baseline, 1 AVX2, 2 AVX-512.");
    m.def("hamming", &hamming, "query"_a.noconvert(), "train"_a.noconvert(),
          "Distances in bits of all pairs, (N, M).");
    m.def("match_mutual", &mutual, "query"_a.noconvert(), "train"_a.noconvert(), "group"_a.noconvert(),
          "groups"_a, "max_distance"_a, "ratio"_a,
          "Index of the mutually nearest group of train descriptors, or -1.");
    m.def("match_windowed", &windowed, "query"_a.noconvert(), "query_xy"_a.noconvert(),
          "query_view"_a.noconvert(), "train"_a.noconvert(), "train_xy"_a.noconvert(),
          "train_view"_a.noconvert(), "radius"_a, "max_distance"_a, "ratio"_a,
          "Index of the nearest train descriptor of the same view within the radius, or -1.");
}

}  // namespace facetcam
