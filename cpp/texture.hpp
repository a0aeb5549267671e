// A picture among texels.
#pragma once
#include <cstdint>

namespace facetcam {

// Where a picture lies among the texels; the halved copies of a mip map follow it.
struct Texture {
    std::int32_t offset, width, height, levels;
};

}  // namespace facetcam
