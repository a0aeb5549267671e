// The thin border to Python: checks array types, releases the GIL, calls the kernels.
#include "bindings.hpp"

NB_MODULE(_core, m) {
    m.doc() = "Native kernels of facetcam.";
    facetcam::bind_bundle(m);
    facetcam::bind_features(m);
    facetcam::bind_remap(m);
    facetcam::bind_tracing(m);
    facetcam::bind_triangles(m);
    facetcam::bind_patch(m);
}
