// The robust corner detector: octaves, scales, suppression across scale, choice of the best, orientation.
#pragma once
#include <string>
#include <vector>

#include "corner_levels.hpp"
#include "light.hpp"

namespace facetcam {

struct DetectorOptions {
    std::vector<LevelSpec> levels;
    HarrisOptions harris;
    float cross_scale;  // a corner yields to a stronger one of another level nearer than this, source pixels
    int max_features;   // 0: all
    int cell;           // side of the cells of an even spread, source pixels; 0: the strongest anywhere
    int border;         // source pixels
    bool oriented;
    int threads;
    Isa isa;
};

struct Keypoint {
    float x, y, size, angle, response;
    int level;
};

// Sorted by falling response, then y, then x.
std::vector<Keypoint> detect_corners(const ImageView& image, const MaskView& mask,
                                     const std::vector<float>& table, const DetectorOptions& options);

}  // namespace facetcam
