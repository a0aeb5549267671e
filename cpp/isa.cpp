#include "isa.hpp"

namespace facetcam {

Isa best_isa() {
#ifdef FACETCAM_X86
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
        return Isa::avx512;
    if (__builtin_cpu_supports("avx2")) return Isa::avx2;
#endif
    return Isa::baseline;
}

Isa usable_isa(int wanted) {
    const Isa best = best_isa();
    return wanted < 0 || wanted > static_cast<int>(best) ? best : static_cast<Isa>(wanted);
}

}  // namespace facetcam
