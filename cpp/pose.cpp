#include "pose.hpp"

#include <algorithm>

#include "bundle_errors.hpp"
#include "skyline.hpp"

namespace facetcam {

namespace {

constexpr double kFloor = 1e-9, kLongestStep = 0.3, kConverged = 1e-6;
constexpr double kWidest = 8.0;  // of the loss, in units of sigma
constexpr int kNarrowing = 4;    // steps in which it narrows

}  // namespace

Rigid refine_pose(const Pinholes& pinholes, Rigid T_world_rig, const std::vector<Vec3d>& points,
                  const std::vector<Observation>& observations, double sigma, int max_steps) {
    Skyline system({0});
    for (int step = 0; step < max_steps; ++step) {
        const double width = sigma * std::max(1.0, kWidest * std::pow(0.5, step));
        const Rigid T_rig_world = T_world_rig.inverse();
        Mat<6, 6> block = kFloor * identity<6>();
        Vec<6> move;
        for (const Observation& seen : observations) {
            const SightError e =
                sight_error(pinholes, T_rig_world, points[static_cast<std::size_t>(seen.point)], seen, width);
            const Mat<2, 6> weighted = e.loss.weight * e.by_frame;
            block += transposed_times(e.by_frame, weighted);
            move -= transposed_times(weighted, e.error);
        }
        for (int i = 0; i < 6; ++i)
            std::copy_n(&block.v[static_cast<std::size_t>(6 * i)], i + 1, system.row(i));
        if (!system.factorise()) break;
        system.solve(move.v.data());
        double largest = 0;
        for (double& x : move.v) {
            largest = std::max(largest, std::abs(x));
            x = std::clamp(x, -kLongestStep, kLongestStep);
        }
        T_world_rig = T_world_rig.moved(move);
        if (step >= kNarrowing && largest < kConverged) break;
    }
    return orthonormal(T_world_rig);
}

}  // namespace facetcam
