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

Isa best_isa() {
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
        return Isa::avx512;
    return __builtin_cpu_supports("avx2") ? Isa::avx2 : Isa::baseline;
}

const RowKernels& row_kernels(Isa isa) {
    const Isa best = best_isa();
    if (isa > best) isa = best;
    return isa == Isa::avx512 ? avx512::kernels : isa == Isa::avx2 ? avx2::kernels : baseline::kernels;
}
#else
Isa best_isa() { return Isa::baseline; }
const RowKernels& row_kernels(Isa) { return baseline::kernels; }
#endif

}  // namespace facetcam
