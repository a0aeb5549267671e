// Instruction sets that kernels are compiled for. Every variant does the same integer and IEEE operations in
// the same order, so that results are identical bit for bit.
#pragma once

namespace facetcam {

enum class Isa { baseline = 0, avx2 = 1, avx512 = 2 };

// The best instruction set of this machine.
Isa best_isa();
// The wanted one, or the best one where the machine lacks it or none is wanted (-1).
Isa usable_isa(int wanted);

}  // namespace facetcam
