// How much a patch looks like itself a little further.
#pragma once
#include <cstdint>

namespace facetcam {

constexpr int kMostRadius = 7;  // of a window: its rows are multiplied 16 pixels at once

struct Likeness {
    float correlation;  // zero-mean normalised, -1 where there was nothing to compare
    float dx, dy;       // whole pixels to the likest place
};

// Compares the window of `radius` round (x, y) with all others of a square patch of `size` pixels whose
// middles lie `apart` or more from there. Pixels are smoothed first: what one of them says is noise.
Likeness self_similarity(const std::uint8_t* patch, int size, int x, int y, int radius, float apart);

}  // namespace facetcam
