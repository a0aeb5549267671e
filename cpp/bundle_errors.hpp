// Errors of single observations and motions, their derivatives and their robust weights.
#pragma once
#include "bundle.hpp"

namespace facetcam {

constexpr double kLeastDepth = 1e-3;  // metres before a pinhole

// Cauchy loss of a squared error, and the weight that its derivative gives the error.
struct Loss {
    double value, weight;
};
Loss cauchy(double squared, double scale);

// Linear in a twist of the frame (right hand side of T_world_rig) and in a step of the world point.
struct SightError {
    Vec<2> error;
    Mat<2, 6> by_frame;
    Mat<2, 3> by_point;
    Loss loss;
};

// Loss alone. A point behind its view counts as one a focal length off and pulls nowhere, so that no step
// gains by passing through a pinhole.
double sight_loss(const Pinholes& pinholes, const Rigid& T_rig_world, const Vec3d& point,
                  const Observation& seen, double loss_scale);
SightError sight_error(const Pinholes& pinholes, const Rigid& T_rig_world, const Vec3d& point,
                       const Observation& seen, double loss_scale);

// White error of a motion, linear in the twists of both frames.
struct MotionError {
    Vec<6> error;
    Mat<6, 6> by_i, by_j;
    Loss loss;
};
MotionError motion_error(const Motion& motion, const Rigid& T_world_i, const Rigid& T_world_j);

}  // namespace facetcam
