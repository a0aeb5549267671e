// Light compensation: a table from grey values to values that an affine change of light leaves alone.
#pragma once
#include <cstdint>
#include <vector>

#include "octaves.hpp"

namespace facetcam {

struct LightLevels {
    double black, median;
};

struct MaskView {
    const std::uint8_t* data;  // null: every pixel counts
    std::ptrdiff_t row_stride, column_stride;
    bool at(int x, int y) const { return !data || data[y * row_stride + x * column_stride]; }
};

// Black level (1 % quantile) and median of the unmasked pixels of an 8 or 16 bit image.
LightLevels measure_light(const ImageView& image, const MaskView& mask);

// (1 + eta / 64) / 2 log((64 (grey - black) / (median - black + 1) + eta) / (64 + eta)) for every grey value
// of the pixel type, with slope 1/2 at the median whatever eta. In steps of kValueUnit, of which
// +-kLargestStep reach from 0.3 below the black level to 3.7 above it.
std::vector<std::int16_t> log_table(PixelType type, const LightLevels& light, double eta);

}  // namespace facetcam
