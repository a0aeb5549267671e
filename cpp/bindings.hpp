// What each part of the core adds to the Python module.
#pragma once
#include <nanobind/nanobind.h>

namespace facetcam {

void bind_features(nanobind::module_& m);

}  // namespace facetcam
