#include "tracing.hpp"

#include <cmath>
#include <limits>

namespace facetcam {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kStart = 1e-9;  // metres: a ray does not meet what it starts on

double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

bool inside(const FlatMirror& mirror, const double* point) {
    for (int i = 0; i < mirror.bound_count; ++i) {
        const double* bound = mirror.bounds + 4 * i;
        if (dot(bound, point) < bound[3]) return false;
    }
    return true;
}

struct Hit {
    std::int8_t mirror;
    double distance;
    double point[3];
};

Hit nearest(const std::vector<FlatMirror>& mirrors, int skip, const double* origin, const double* direction) {
    Hit hit{kLeaves, kInfinity, {0, 0, 0}};
    for (int m = 0; m < static_cast<int>(mirrors.size()); ++m) {
        if (m == skip) continue;  // a flat mirror is not met twice in a row
        const FlatMirror& mirror = mirrors[m];
        const double height = mirror.offset - dot(mirror.normal, origin),
                     slope = dot(mirror.normal, direction);
        if (!(height * slope > 0)) continue;  // behind the ray, before the slow division
        const double distance = height / slope;
        if (!(distance > kStart && distance < hit.distance)) continue;
        const double point[3] = {origin[0] + distance * direction[0], origin[1] + distance * direction[1],
                                 origin[2] + distance * direction[2]};
        if (inside(mirror, point))
            hit = {static_cast<std::int8_t>(m), distance, {point[0], point[1], point[2]}};
    }
    return hit;
}

// Moves the point where a ray enters a mirror's glass to where it leaves it; false if it leaves by the edge.
bool cross_glass(const FlatMirror& mirror, const double* direction, double cosine, double* point,
                 double* way) {
    const double slant = 2 * mirror.thickness / std::sqrt(mirror.index * mirror.index - 1 + cosine * cosine);
    for (int i = 0; i < 3; ++i) point[i] += slant * (direction[i] - cosine * mirror.normal[i]);
    *way += slant;
    return inside(mirror, point);
}

}  // namespace

void trace(const std::vector<FlatMirror>& mirrors, const double* aim, int bounces, std::size_t stride,
           std::int8_t* sequence, double* length) {
    double origin[3] = {0, 0, 0}, direction[3] = {aim[0], aim[1], aim[2]};
    const bool exists = dot(direction, direction) > 0;
    Hit hit{exists ? kLeaves : kNowhere, kInfinity, {0, 0, 0}};
    double way = exists ? 0 : kInfinity;
    for (int b = 0; b < bounces; ++b) {
        if (way < kInfinity) {
            hit = nearest(mirrors, hit.mirror, origin, direction);
            way += hit.distance;
        }
        sequence[b * stride] = hit.mirror;
        length[b * stride] = way;
        if (hit.mirror < 0) continue;
        const FlatMirror& mirror = mirrors[hit.mirror];
        const double* normal = mirror.normal;
        const double cosine = dot(normal, direction);
        if (mirror.thickness > 0 && !cross_glass(mirror, direction, cosine, hit.point, &way)) {
            hit.mirror = kNowhere;
            way = kInfinity;
            continue;
        }
        for (int i = 0; i < 3; ++i) {
            origin[i] = hit.point[i];
            direction[i] -= 2 * cosine * normal[i];
        }
    }
}

}  // namespace facetcam
