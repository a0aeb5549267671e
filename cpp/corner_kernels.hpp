// Row kernels of the corner detector. The same source is compiled once per instruction set; every variant
// does the same IEEE operations in the same order, so the results are identical bit for bit.
#pragma once
#include <cstdint>

namespace facetcam {

enum class Isa { baseline = 0, avx2 = 1, avx512 = 2 };

struct RowKernels {
    // out[x] = taps[0] * rows[radius][x] + sum_i taps[i] * (rows[radius - i][x] + rows[radius + i][x]);
    // a column filter with pointers to different rows, a row filter with shifted pointers to one row.
    void (*symmetric_filter)(const float* const* rows, const float* taps, int radius, int n, float* out);
    // Products of the central-difference gradient g, divided by |g| + compression.
    void (*gradient_products)(const float* above, const float* row, const float* below, float gain,
                              float compression, int n, float* xx, float* xy, float* yy);
    // det - alpha trace^2 of the windowed second-moment matrix.
    void (*harris)(const float* xx, const float* xy, const float* yy, float alpha, int n, float* out);
    // flags[x] = 1 where row[x] > floor and no 3x3 neighbour is greater.
    void (*peaks)(const float* above, const float* row, const float* below, float floor, int n,
                  std::uint8_t* flags);
};

// The best instruction set of this machine, or the wanted one if the machine has it.
Isa best_isa();
const RowKernels& row_kernels(Isa isa);

}  // namespace facetcam
