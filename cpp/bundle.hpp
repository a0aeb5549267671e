// Bundle adjustment of a generalised camera: rig poses and points from what ideal pinholes on the rig saw.
#pragma once
#include <vector>

#include "small_matrix.hpp"

namespace facetcam {

// A rigid set of ideal pinholes of one focal length, principal point (0, 0).
struct Pinholes {
    double focal;
    std::vector<Rigid> T_view_rig;
};

constexpr int kShared = 3;  // numbers of a camera that move all observations

struct Observation {
    int frame, view, point;
    double x, y;
    Mat<2, kShared> by_shared{};  // shift of the error, linear in the shared numbers
    Vec<2> edge{};  // g, along the edge on which the point lies: of its error e, e - g g' e counts
};

// The shared numbers with which observations are where they are, and the weights with which they are zero.
struct Shared {
    bool free = false;
    Vec<kShared> value{}, weight{};
};

// A measured motion of frame j in frame i. `root` makes its error, rotation before translation, white; beyond
// `loss_scale` of these units a Cauchy loss flattens, infinity for none.
struct Motion {
    int i, j;
    Rigid T_i_j;
    Mat<6, 6> root;
    double loss_scale;
};

struct Bundle {
    Pinholes pinholes;
    std::vector<Rigid> T_world_rig;
    std::vector<bool> fixed;
    std::vector<Vec3d> points;
    std::vector<Observation> observations;
    std::vector<Motion> motions;
    double loss_scale;  // pixels beyond which the Cauchy loss of observations flattens
    Shared shared{};
};

struct Adjustment {
    double first_cost, cost;
    int iterations;
};

// Moves free poses, all points and, where they are free, the shared numbers to the least cost (half the sum
// of the losses) by Levenberg-Marquardt on the Schur complement. Every sum is made in one order, so that any
// number of threads gives the same bits.
Adjustment adjust(Bundle& bundle, int max_iterations, double tolerance, int threads);

}  // namespace facetcam
