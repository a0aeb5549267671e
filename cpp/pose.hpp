// Pose of a generalised camera from points that are known.
#pragma once
#include "bundle.hpp"

namespace facetcam {

// Iteratively reweighted Gauss-Newton with a Cauchy loss that starts eight times `sigma` pixels wide and
// narrows, so that a poor first pose is pulled in by all observations.
Rigid refine_pose(const Pinholes& pinholes, Rigid T_world_rig, const std::vector<Vec3d>& points,
                  const std::vector<Observation>& observations, double sigma, int max_steps);

}  // namespace facetcam
