#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>

#include "bindings.hpp"
#include "parallel.hpp"
#include "patch.hpp"
#include "self_similarity.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Image = nb::ndarray<const std::uint8_t, nb::ndim<2>, nb::device::cpu>;
using Patches = nb::ndarray<const std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <int Dimensions>
using Floats = nb::ndarray<const float, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;

facetcam::Grey8 grey(const Image& image) {
    if (image.stride(1) != 1) throw nb::value_error("align_patches: rows of the image must be contiguous");
    return {image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0)),
            image.stride(0)};
}

auto align_patches(const Image& full, const Image& half, const Patches& patches, const Floats<2>& offsets,
                   const Floats<3>& warps, const Floats<2>& start, float max_shift, int max_iterations,
                   int threads, int isa) {
    const std::size_t n = patches.shape(0);
    if (patches.shape(1) != patches.shape(2) || offsets.shape(0) != n || warps.shape(0) != n ||
        start.shape(0) != n || offsets.shape(1) != 2 || start.shape(1) != 2 || warps.shape(1) != 2 ||
        warps.shape(2) != 2)
        throw nb::value_error(
            "align_patches: expected patches (N,P,P), offsets (N,2), warps (N,2,2), start (N,2)");
    const facetcam::Grey8 level0 = grey(full), level1 = grey(half);
    const int size = static_cast<int>(patches.shape(1));
    const auto align = facetcam::patch_aligner(facetcam::usable_isa(isa));
    float* out = new float[n * 4];
    nb::capsule owner(out, [](void* p) noexcept { delete[] static_cast<float*>(p); });
    {
        nb::gil_scoped_release release;
        facetcam::parallel_for(static_cast<int>(n), threads, [&](int task) {
            const std::size_t i = static_cast<std::size_t>(task);
            facetcam::Reference reference{
                patches.data() + i * size * size, size, offsets(i, 0), offsets(i, 1), {}};
            for (int k = 0; k < 4; ++k) reference.warp[k] = warps(i, k / 2, k % 2);
            const facetcam::Alignment a =
                align(level0, level1, reference, start(i, 0), start(i, 1), max_shift, max_iterations);
            out[4 * i] = a.x;
            out[4 * i + 1] = a.y;
            out[4 * i + 2] = a.score;
            out[4 * i + 3] = a.spread;
        });
    }
    return nb::ndarray<nb::numpy, float, nb::ndim<2>>(out, {n, 4}, owner);
}

auto self_similarities(const Patches& patches, const Floats<2>& offsets, int radius, float apart,
                       int threads) {
    const std::size_t n = patches.shape(0);
    if (patches.shape(1) != patches.shape(2) || offsets.shape(0) != n || offsets.shape(1) != 2)
        throw nb::value_error("self_similarity: expected patches (N,P,P), offsets (N,2)");
    if (radius < 0 || radius > facetcam::kMostRadius)
        throw nb::value_error("self_similarity: a window's radius is 7 pixels at most");
    const int size = static_cast<int>(patches.shape(1));
    float* out = new float[n * 3];
    nb::capsule owner(out, [](void* p) noexcept { delete[] static_cast<float*>(p); });
    {
        nb::gil_scoped_release release;
        facetcam::parallel_for(static_cast<int>(n), threads, [&](int task) {
            const std::size_t i = static_cast<std::size_t>(task);
            const int x = size / 2 + static_cast<int>(std::lround(offsets(i, 0)));
            const int y = size / 2 + static_cast<int>(std::lround(offsets(i, 1)));
            const facetcam::Likeness found =
                facetcam::self_similarity(patches.data() + i * size * size, size, x, y, radius, apart);
            out[3 * i] = found.correlation;
            out[3 * i + 1] = found.dx;
            out[3 * i + 2] = found.dy;
        });
    }
    return nb::ndarray<nb::numpy, float, nb::ndim<2>>(out, {n, 3}, owner);
}

}  // namespace

void facetcam::bind_patch(nb::module_& m) {
    m.def("align_patches", &align_patches, "full"_a.noconvert(), "half"_a.noconvert(),
          "patches"_a.noconvert(), "offsets"_a.noconvert(), "warps"_a.noconvert(), "start"_a.noconvert(),
          "max_shift"_a, "max_iterations"_a, "threads"_a, "isa"_a = -1,
          "Positions, correlation and spread (N, 4) of patches found in an image.");
    m.def("self_similarity", &self_similarities, "patches"_a.noconvert(), "offsets"_a.noconvert(), "radius"_a,
          "apart"_a, "threads"_a,
          "Correlation of windows with the likest others of their patches, and the way there (N, 3).");
}
