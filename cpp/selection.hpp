// Which corners stay: suppression across scales and the choice of the best.
#pragma once
#include <vector>

#include "corner_levels.hpp"

namespace facetcam {

// Falling response, then y, then x: the total order of all results.
bool stronger(const Corner& a, const Corner& b);

// Of sorted corners, drops those with a stronger corner of another level within `radius`; stops at `wanted`
// (0: never). Width and height bound the coordinates.
std::vector<Corner> suppress_across_levels(const std::vector<Corner>& corners, float radius, int width,
                                           int height, std::size_t wanted);

// Of sorted corners, takes the best of every cell, then the second best of every cell, and so on.
std::vector<Corner> spread_evenly(const std::vector<Corner>& corners, int cell, int width,
                                  std::size_t wanted);

}  // namespace facetcam
