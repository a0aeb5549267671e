// Follow camera rays from flat mirror to flat mirror.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

namespace facetcam {

constexpr std::int8_t kLeaves = -1;   // the ray meets no further mirror
constexpr std::int8_t kNowhere = -2;  // there is no ray (zero direction), or the edge of the glass took it

// The plane normal.x = offset, bounded by half spaces (a, b, c, d): a x + b y + c z >= d. It reflects at
// `thickness` behind it, in glass of refractive index `index`; a thickness of 0 is a first-surface mirror.
struct FlatMirror {
    double normal[3], offset;
    double thickness, index;
    const double* bounds;
    int bound_count;
};

// Trace one ray from the origin through up to `bounces` mirrors.
// sequence[b * stride] is the b-th mirror that it meets, or kLeaves, or kNowhere;
// length[b * stride] is the way to it, infinite where there is none; glass on the way adds 2 t / sqrt(n^2 -
// sin^2), which keeps it the straight distance from where the ray seems to start.
void trace(const std::vector<FlatMirror>& mirrors, const double* direction, int bounces, std::size_t stride,
           std::int8_t* sequence, double* length);

}  // namespace facetcam
