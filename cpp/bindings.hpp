// What each part of the core adds to the Python module, and what their borders share.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <initializer_list>
#include <utility>
#include <vector>

namespace facetcam {

void bind_bundle(nanobind::module_& m);
void bind_features(nanobind::module_& m);
void bind_patch(nanobind::module_& m);
void bind_remap(nanobind::module_& m);
void bind_tracing(nanobind::module_& m);
void bind_triangles(nanobind::module_& m);

// Hands a vector over to NumPy without a copy.
template <class Array, class T>
Array to_numpy(std::vector<T> values, std::initializer_list<std::size_t> shape) {
    auto* owned = new std::vector<T>(std::move(values));
    nanobind::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
    return Array(owned->data(), shape, owner);
}

}  // namespace facetcam
