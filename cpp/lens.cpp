#include "lens.hpp"

#include <algorithm>
#include <cmath>

namespace facetcam {

namespace {

constexpr double kNearlySolved = 1e-7;  // error before the last step of Newton's method
constexpr double kSolved = 1e-14;       // error at which the bracketed search stops
constexpr double kAccepted = 1e-10;     // error of an accepted radius; 1e-7 px at f = 1000
constexpr int kNewtonSteps = 25;
constexpr int kBracketSteps = 60;
constexpr double kWidest = 1e3;  // plane radius of a lens without limit

}  // namespace

struct Lens::Distorted {
    double x, y;
    double xx, xy, yy;  // symmetric Jacobian
    double determinant() const { return xx * yy - xy * xy; }
};

Lens::Distorted Lens::distort_radially(double radius) const {
    const double r2 = radius * radius;
    const auto& k = radial;
    const double scale = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
    const double slope = 1 + r2 * (3 * k[0] + r2 * (5 * k[1] + r2 * (7 * k[2] + r2 * 9 * k[3])));
    return {radius * scale, 0, slope, 0, scale};
}

Lens::Distorted Lens::distort(double x, double y) const {
    const double r2 = x * x + y * y;
    const auto& k = radial;
    const double scale = 1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3])));
    const double slope = k[0] + r2 * (2 * k[1] + r2 * (3 * k[2] + r2 * 4 * k[3]));
    const double p1 = tangential[0], p2 = tangential[1];
    return {x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            scale + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
            scale + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x};
}

bool Lens::project(const double* point, double* pixel) const {
    double x, y;
    if (kannala_brandt) {
        const double radius = std::hypot(point[0], point[1]);
        const double angle = std::atan2(radius, point[2]);
        if (!(angle <= limit) || (radius == 0 && point[2] <= 0)) return false;
        const double scale = radius > 0 ? angle / radius : 0;
        x = point[0] * scale, y = point[1] * scale;
    } else {
        if (!(point[2] > 0)) return false;
        x = point[0] / point[2], y = point[1] / point[2];
        if (!(x * x + y * y <= limit * limit)) return false;
    }
    const Distorted d = distort(x, y);
    pixel[0] = fx * d.x + cx;
    pixel[1] = fy * d.y + cy;
    const bool inside =
        pixel[0] >= -0.5 && pixel[0] < width - 0.5 && pixel[1] >= -0.5 && pixel[1] < height - 0.5;
    return inside && d.determinant() > 0;
}

bool Lens::ray(const double* pixel, double* direction) const {
    const double target[2] = {(pixel[0] - cx) / fx, (pixel[1] - cy) / fy};
    if (kannala_brandt ? ray_kannala_brandt(target, direction) : ray_brown_conrady(target, direction))
        return true;
    std::fill(direction, direction + 3, 0.0);
    return false;
}

// Newton's method on both plane coordinates; true if it ends at a solution in the one-to-one field.
bool Lens::descend(const double* target, double* plane) const {
    for (int step = 0; step < kNewtonSteps; ++step) {
        const Distorted d = distort(plane[0], plane[1]);
        const double ex = d.x - target[0], ey = d.y - target[1];
        const double determinant = d.determinant();
        if (!(std::abs(determinant) > 1e-12)) return false;
        plane[0] -= (d.yy * ex - d.xy * ey) / determinant;
        plane[1] -= (d.xx * ey - d.xy * ex) / determinant;
        // The step just made squares this error, so there is no need to look at it again.
        if (std::abs(ex) + std::abs(ey) < kNearlySolved)
            return determinant > 0 && plane[0] * plane[0] + plane[1] * plane[1] <= limit * limit;
    }
    return false;
}

// Radius below the limit whose radial distortion gives `distorted`: Newton's method kept inside a bracket.
double Lens::invert_radius(double distorted) const {
    double low = 0, high = std::min(limit, kWidest);
    double radius = std::min(distorted, high);
    for (int step = 0; step < kBracketSteps; ++step) {
        const Distorted d = distort_radially(radius);
        const double error = d.x - distorted;
        if (std::abs(error) < kSolved) break;
        (error < 0 ? low : high) = radius;
        const double next = radius - error / d.xx;
        radius = next > low && next < high ? next : 0.5 * (low + high);
    }
    return radius;
}

bool Lens::ray_brown_conrady(const double* target, double* direction) const {
    double plane[2] = {target[0], target[1]};
    if (!descend(target, plane)) {
        // Strong distortion throws the first step out of the field: start from the radial part alone.
        const double distorted = std::hypot(target[0], target[1]);
        const double scale = invert_radius(distorted) / distorted;
        plane[0] = target[0] * scale, plane[1] = target[1] * scale;
        if (!descend(target, plane)) return false;
    }
    const double norm = std::sqrt(1 + plane[0] * plane[0] + plane[1] * plane[1]);
    direction[0] = plane[0] / norm, direction[1] = plane[1] / norm, direction[2] = 1 / norm;
    return true;
}

bool Lens::ray_kannala_brandt(const double* target, double* direction) const {
    const double distorted = std::hypot(target[0], target[1]);
    const double angle = invert_radius(distorted);
    if (!(std::abs(distort_radially(angle).x - distorted) < kAccepted)) return false;
    const double scale = distorted > 0 ? std::sin(angle) / distorted : 0;
    direction[0] = target[0] * scale, direction[1] = target[1] * scale, direction[2] = std::cos(angle);
    return true;
}

}  // namespace facetcam
