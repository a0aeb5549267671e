#include "corner_kernels.hpp"

namespace facetcam {

namespace baseline {
extern const RowKernels kernels;
}
#ifdef FACETCAM_X86
namespace avx2 {
extern const RowKernels kernels;
}
namespace avx512 {
extern const RowKernels kernels;
}

const RowKernels& row_kernels(Isa isa) {
    return isa == Isa::avx512 ? avx512::kernels : isa == Isa::avx2 ? avx2::kernels : baseline::kernels;
}
#else
const RowKernels& row_kernels(Isa) { return baseline::kernels; }
#endif

}  // namespace facetcam
