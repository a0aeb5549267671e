// Peak of the quadratic through a 3x3 neighbourhood.
#pragma once
#include <algorithm>

namespace facetcam {

struct Offset {
    float x, y;
};

// The pointers stand at the centre column. A degenerate or far peak stays within half a pixel of the centre.
inline Offset subpixel(const float* above, const float* row, const float* below) {
    const float gx = 0.5f * (row[1] - row[-1]), gy = 0.5f * (below[0] - above[0]);
    const float xx = row[1] + row[-1] - 2.0f * row[0], yy = below[0] + above[0] - 2.0f * row[0];
    const float xy = 0.25f * ((below[1] + above[-1]) - (below[-1] + above[1]));
    const float det = xx * yy - xy * xy;
    if (!(det > 0.0f)) return {0.0f, 0.0f};
    const float dx = (xy * gy - yy * gx) / det, dy = (xy * gx - xx * gy) / det;
    return {std::clamp(dx, -0.5f, 0.5f), std::clamp(dy, -0.5f, 0.5f)};
}

}  // namespace facetcam
