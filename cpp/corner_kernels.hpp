// Row kernels of the corner detector, compiled once per instruction set.
#pragma once
#include <cstdint>

#include "isa.hpp"

namespace facetcam {

// Values are fixed point with kValueUnit steps of the logarithm, products of gradients with kProductUnit
// steps. Neither exceeds kLargestStep, and the taps of a filter sum up to kTapSum: a sum down a column is
// exact in 16 bits and one along a row of such sums in 32, so rows and columns can change places.
constexpr float kValueUnit = 512.0f, kProductUnit = 1024.0f;
constexpr int kLargestStep = 1023, kTapSum = 32;
// A row that was blurred both ways keeps this many steps for one of the values.
constexpr int kBlurredSteps = 16;

struct RowKernels {
    // out[x] = table[pixels[x]]
    void (*transfer)(const std::uint8_t* pixels, const std::int16_t* table, int n, std::int16_t* out);
    // out[x] = taps[0] * rows[radius][x] + sum_i taps[i] * (rows[radius - i][x] + rows[radius + i][x])
    void (*filter_columns)(const std::int16_t* const* rows, const std::int16_t* taps, int radius, int n,
                           std::int16_t* out);
    // The same along a row of such sums, in kBlurredSteps. The row has `radius` more pixels on both sides,
    // and `n` is a multiple of 64.
    void (*blur_row)(const std::int16_t* row, const std::int16_t* taps, int radius, int n, std::int16_t* out);
    // Products of the central-difference gradient g times gain / sqrt(g^2 + floor), rounded; components of g
    // are cut at `most`, and `row` has one more pixel on both sides.
    void (*gradient_products)(const std::int16_t* above, const std::int16_t* row, const std::int16_t* below,
                              float gain, float floor, std::int16_t most, int n, std::int16_t* xx,
                              std::int16_t* xy, std::int16_t* yy);
    // scale * max(det - alpha trace^2, 0) of sums of products, summed along the row as above, plus
    // weight * coarse[x]. Pixels as in blur_row.
    void (*corner_response)(const std::int16_t* xx, const std::int16_t* xy, const std::int16_t* yy,
                            const std::int16_t* taps, int radius, float alpha, float scale,
                            const float* coarse, float weight, int n, float* out);
    // flags[x] = 1 where row[x] > floor and none of the four next pixels is greater.
    void (*peaks)(const float* above, const float* row, const float* below, float floor, int n,
                  std::uint8_t* flags);
    // Every second value, smoothed with a variance of 0.75 pixels^2: between two pixels by [1 3 3 1] (`odd`
    // false) or on a pixel by [1 8 14 8 1]. Columns take four or five rows and n values and give sums; rows
    // of such sums are divided by 2^shift and rounded.
    void (*halve_columns)(const std::int16_t* const* rows, bool odd, int n, std::int16_t* out);
    void (*halve_row)(const std::int16_t* in, bool odd, int shift, int n, std::int16_t* out);
    // A row of the finer grid, bilinear between two rows of n values, whose weights are `weight` and the
    // rest: out has 2n values (odd: 2n - 1). Corners of a cell are added crosswise, so rows and columns can
    // change places.
    void (*stretch)(const float* near, const float* far, float weight, bool odd, int n, float* out);
};

// Those of an instruction set that the machine has.
const RowKernels& row_kernels(Isa isa);

}  // namespace facetcam
