// Lens models: plane coordinates to pixels and back.
#pragma once

namespace facetcam {

// One camera: brown-conrady (k1 k2 k3 radial, p1 p2 tangential) or kannala-brandt (k1..k4 on the angle).
struct Lens {
    bool kannala_brandt;
    double width, height, fx, fy, cx, cy;
    double radial[4];      // of 1 + a r^2 + b r^4 + ...
    double tangential[2];  // p1, p2
    double limit;  // radius (kannala-brandt: angle) up to which distorted radius grows with the true one

    // Pixel of a point (3) of the camera frame; false where it has none on the sensor.
    bool project(const double* point, double* pixel) const;
    // Unit direction (3) of a pixel; false and zero where the lens gives none.
    bool ray(const double* pixel, double* direction) const;

 private:
    struct Distorted;
    Distorted distort(double x, double y) const;
    Distorted distort_radially(double radius) const;  // along the x axis, without p1 and p2
    bool descend(const double* target, double* plane) const;
    double invert_radius(double distorted) const;
    bool ray_brown_conrady(const double* target, double* direction) const;
    bool ray_kannala_brandt(const double* target, double* direction) const;
};

}  // namespace facetcam
