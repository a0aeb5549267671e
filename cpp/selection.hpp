// Corners: local maxima of the response and the choice of the best.
#pragma once
#include <vector>

#include "corner_levels.hpp"

namespace facetcam {

struct Corner {
    float x, y;
    float response;  // root of the summed measures
};

struct PeakOptions {
    float threshold;  // least response
    int radius;       // half width of the window a corner must win
    int border;       // no corner nearer to the edge
};

// Maxima with sub-pixel places among the rows [first, last), in rising y, then x.
std::vector<Corner> find_peaks(ResponseRows& rows, int width, int height, const PeakOptions& options,
                               const RowKernels& kernels, int first, int last);

// Falling response, then y, then x: the total order of all results.
bool stronger(const Corner& a, const Corner& b);

// Of sorted corners, takes the best of every cell, then the second best of every cell, and so on.
std::vector<Corner> spread_evenly(const std::vector<Corner>& corners, int cell, int width,
                                  std::size_t wanted);

}  // namespace facetcam
