// Row kernels of the corner detector. The same source is compiled once per instruction set; every variant
// does the same integer and IEEE operations in the same order, so the results are identical bit for bit.
#pragma once
#include <cstdint>

namespace facetcam {

enum class Isa { baseline = 0, avx2 = 1, avx512 = 2 };

// Values are fixed point with kValueUnit steps of the logarithm, products of gradients with kProductUnit
// steps. Both stay far enough below 2^14 that a sum of two, times taps that are rounded, fits.
constexpr float kValueUnit = 4096.0f, kProductUnit = 8192.0f;
constexpr int kLargestStep = 16300;

struct RowKernels {
    // out[x] = table[pixels[x]]
    void (*transfer)(const std::uint8_t* pixels, const std::int16_t* table, int n, std::int16_t* out);
    // out[x] = taps[0] * rows[radius][x] + sum_i taps[i] * (rows[radius - i][x] + rows[radius + i][x]);
    // a column filter with pointers to different rows, a row filter with shifted pointers to one row. Taps
    // have 2^15 steps, and every product is rounded.
    void (*symmetric_filter)(const std::int16_t* const* rows, const std::int16_t* taps, int radius, int n,
                             std::int16_t* out);
    // Products of the central-difference gradient g times gain / sqrt(g^2 + floor), rounded; components of g
    // are cut at `most`, and `row` has one more pixel on both sides.
    void (*gradient_products)(const std::int16_t* above, const std::int16_t* row, const std::int16_t* below,
                              float gain, float floor, std::int16_t most, int n, std::int16_t* xx,
                              std::int16_t* xy, std::int16_t* yy);
    // A column filter as above that rounds only the sum. `n` is a multiple of 64.
    void (*window_rows)(const std::int16_t* const* rows, const std::int16_t* taps, int radius, int n,
                        std::int16_t* out);
    // scale * max(det - alpha trace^2, 0) of the products windowed along the row by taps in steps of 2^-15
    // (not divided by 2^15), plus weight * coarse[x]; the products have `radius` more pixels on both sides,
    // and `n` is a multiple of 64.
    void (*corner_response)(const std::int16_t* xx, const std::int16_t* xy, const std::int16_t* yy,
                            const std::int16_t* taps, int radius, float alpha, float scale,
                            const float* coarse, float weight, int n, float* out);
    // flags[x] = 1 where row[x] > floor and none of the four next pixels is greater.
    void (*peaks)(const float* above, const float* row, const float* below, float floor, int n,
                  std::uint8_t* flags);
    // Every second value, smoothed with a variance of 0.75 pixels^2: between two pixels by [1 3 3 1] / 8
    // (`odd` false) or on a pixel by [1 8 14 8 1] / 32. Columns take four or five rows and n values.
    void (*halve_row)(const std::int16_t* in, bool odd, int n, std::int16_t* out);
    void (*halve_column)(const std::int16_t* const* rows, bool odd, int n, std::int16_t* out);
    // out[x] = weight a[x] + (1 - weight) b[x]
    void (*blend)(const float* a, const float* b, float weight, int n, float* out);
    // Inverse grid of halve_row, linear between the n values: out has 2n (odd: 2n - 1).
    void (*stretch_row)(const float* in, bool odd, int n, float* out);
};

// The best instruction set of this machine, or the wanted one if the machine has it.
Isa best_isa();
const RowKernels& row_kernels(Isa isa);

}  // namespace facetcam
