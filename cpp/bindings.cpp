// The thin border to Python: checks array types, releases the GIL, calls the kernels.
#include <nanobind/nanobind.h>

namespace nb = nanobind;

NB_MODULE(_core, m) { m.doc() = "Native kernels of facetcam."; }
