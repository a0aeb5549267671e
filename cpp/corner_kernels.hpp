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
    // Products of the central-difference gradient g, or of g / sqrt(|g| + compression) where that is not 0;
    // `row` has one more pixel on both sides.
    void (*gradient_products)(const float* above, const float* row, const float* below, float gain,
                              float compression, int n, float* xx, float* xy, float* yy);
    // sqrt(max(det - alpha trace^2, 0)) of the products windowed along the row, plus weight * coarse[x]; the
    // products have `radius` more pixels on both sides.
    void (*corner_response)(const float* xx, const float* xy, const float* yy, const float* taps, int radius,
                            float alpha, const float* coarse, float weight, int n, float* out);
    // flags[x] = 1 where row[x] > floor and no 3x3 neighbour is greater.
    void (*peaks)(const float* above, const float* row, const float* below, float floor, int n,
                  std::uint8_t* flags);
    // Every second value, smoothed with a variance of 0.75 pixels^2: between two pixels by [1 3 3 1] / 8
    // (`odd` false) or on a pixel by [1 8 14 8 1] / 32. Columns take four or five rows and n values.
    void (*halve_row)(const float* in, bool odd, int n, float* out);
    void (*halve_column)(const float* const* rows, bool odd, int n, float* out);
    // out[x] = weight a[x] + (1 - weight) b[x]
    void (*blend)(const float* a, const float* b, float weight, int n, float* out);
    // Inverse grid of halve_row, linear between the n values: out has 2n (odd: 2n - 1).
    void (*stretch_row)(const float* in, bool odd, int n, float* out);
};

// The best instruction set of this machine, or the wanted one if the machine has it.
Isa best_isa();
const RowKernels& row_kernels(Isa isa);

}  // namespace facetcam
