// Alignment of small image patches under a known affine warp and unknown gain and bias.
#pragma once

#include <cstddef>
#include <cstdint>

#include "isa.hpp"

namespace facetcam {

struct Grey8 {
    const std::uint8_t* data;
    int width;
    int height;
    std::ptrdiff_t stride;
};

struct Alignment {
    float x, y;    // found position in level-0 pixels
    float score;   // zero-mean normalised cross-correlation, -1 where the search failed
    float spread;  // px of position noise per grey level of image noise along the weaker direction
};

// A square reference patch of odd `size`. Its feature sits `offset` from the central pixel.
struct Reference {
    const std::uint8_t* pixels;
    int size;
    float offset_x, offset_y;
    float warp[4];  // row-major 2x2: an offset in the image to an offset in the patch
};

// Finds the patch near (x, y), first in the half-size image, then in the full one. Inverse compositional
// Lucas-Kanade (Baker and Matthews, IJCV 2004) on patches brought to one mean and contrast.
using AlignPatch = Alignment(const Grey8& full, const Grey8& half, const Reference& reference, float x,
                             float y, float max_shift, int max_iterations);

// The variant for an instruction set that the machine has.
AlignPatch* patch_aligner(Isa isa);

}  // namespace facetcam
