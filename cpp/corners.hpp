// The robust corner detector: octaves, responses added over scales, choice of the best, size and direction.
#pragma once
#include <vector>

#include "light.hpp"
#include "selection.hpp"

namespace facetcam {

struct DetectorOptions {
    int scales;
    ResponseOptions response;
    PeakOptions peaks;
    int max_features;  // 0: all
    int cell;          // side of the cells of an even spread, pixels; 0: the strongest anywhere
    bool oriented;
    int threads;
    Isa isa;
};

struct Keypoint {
    float x, y, size, angle, response;
    int level;
};

// Sorted by falling response, then y, then x. The table maps grey values (see light.hpp); float images are
// taken as they are.
std::vector<Keypoint> detect_corners(const ImageView& image, const MaskView& mask,
                                     const std::vector<std::int16_t>& table, const DetectorOptions& options);

}  // namespace facetcam
