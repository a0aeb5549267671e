#include "patch.hpp"

namespace facetcam {

namespace baseline {
extern AlignPatch* const aligner;
}
#ifdef FACETCAM_X86
namespace avx2 {
extern AlignPatch* const aligner;
}
#endif

AlignPatch* patch_aligner([[maybe_unused]] Isa isa) {
#ifdef FACETCAM_X86
    if (isa >= Isa::avx2) return avx2::aligner;  // rows are too short for more
#endif
    return baseline::aligner;
}

}  // namespace facetcam
