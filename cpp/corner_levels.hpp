// One scale of the robust corner detector: blur, compressed gradients, window, Harris, local maxima.
#pragma once
#include <vector>

#include "corner_kernels.hpp"
#include "octaves.hpp"

namespace facetcam {

struct Corner {
    float x, y;  // pixels of the level until `to_source`
    float response;
    int level;
};

struct LevelSpec {
    int octave;
    float blur_sigma, window_sigma;  // pixels of the octave
};

struct HarrisOptions {
    float alpha, compression, floor;
    int suppression;  // half width of the window a corner must win, pixels of the octave
};

std::vector<float> gaussian_taps(float sigma);

// Corners of the rows [first, last) of a level, in rising y, then x.
std::vector<Corner> detect_band(const Octaves& octaves, const LevelSpec& spec, int level,
                                const HarrisOptions& options, const RowKernels& kernels, int first, int last);

}  // namespace facetcam
