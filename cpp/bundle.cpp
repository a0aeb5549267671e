#include "bundle.hpp"

#include <algorithm>

#include "bundle_system.hpp"

namespace facetcam {

namespace {

constexpr double kLeastGain = 1e-3;  // share of the promised decrease that a step must bring
constexpr double kFirstDamping = 1e-4, kLeastDamping = 1e-16, kMostDamping = 1e12;

}  // namespace

// The damping follows Madsen, Nielsen and Tingleff, "Methods for non-linear least squares problems" (2004).
Adjustment adjust(Bundle& bundle, int max_iterations, double tolerance, int threads) {
    BundleSystem system(bundle, threads);
    double damping = kFirstDamping, growth = 2.0, cost = system.cost();
    Adjustment done{cost, cost, 0};
    bool moved = true;
    while (done.iterations < max_iterations && damping < kMostDamping) {
        ++done.iterations;
        if (moved) system.linearise();
        const std::vector<Rigid> poses = bundle.T_world_rig;
        const std::vector<Vec3d> points = bundle.points;
        const Vec<kShared> shared = bundle.shared.value;
        moved = false;
        if (system.solve(damping)) {
            const double promised = system.promise(damping);
            if (!(promised > 1e-3 * tolerance * cost)) break;
            system.step();
            const double now = system.cost(), gain = (cost - now) / promised;
            moved = gain > kLeastGain;
            if (!moved) system.place(poses, points, shared);
            if (moved) {
                const double decrease = cost - now;
                cost = now;
                damping = std::max(kLeastDamping,
                                   damping * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
                growth = 2.0;
                if (decrease <= tolerance * cost) break;
            }
        }
        if (!moved) {
            damping *= growth;
            growth *= 2.0;
        }
    }
    for (std::size_t k = 0; k < bundle.T_world_rig.size(); ++k)
        if (!bundle.fixed[k]) bundle.T_world_rig[k] = orthonormal(bundle.T_world_rig[k]);
    done.cost = cost;
    return done;
}

}  // namespace facetcam
