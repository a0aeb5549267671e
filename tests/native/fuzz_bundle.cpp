// Bundle adjustment on random and on broken problems; run under the sanitizers.
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>

#include "bundle.hpp"
#include "pose.hpp"

using namespace facetcam;

namespace {

std::mt19937 rng(2);

int up_to(int low, int high) { return std::uniform_int_distribution<int>(low, high)(rng); }
double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(rng); }

Rigid any_pose(double size) {
    Vec<6> twist;
    for (double& x : twist.v) x = between(-size, size);
    return Rigid{}.moved(twist);
}

Bundle any_bundle() {
    Bundle b{{between(50, 1000), {}}, {}, {}, {}, {}, {}, between(0.1, 3)};
    const int views = up_to(1, 4), frames = up_to(1, 8), points = up_to(1, 80);
    for (int v = 0; v < views; ++v) b.pinholes.T_view_rig.push_back(any_pose(3));
    for (int k = 0; k < frames; ++k) {
        b.T_world_rig.push_back(any_pose(0.5));
        b.fixed.push_back(up_to(0, 3) == 0);
    }
    for (int p = 0; p < points; ++p) b.points.push_back({{between(-3, 3), between(-3, 3), between(-3, 3)}});
    for (int i = up_to(0, 400); i > 0; --i)
        b.observations.push_back({up_to(0, frames - 1), up_to(0, views - 1), up_to(0, points - 1),
                                  between(-400, 400), between(-400, 400)});
    for (int i = up_to(0, 3); i > 0; --i)
        b.motions.push_back({up_to(0, frames - 1), up_to(0, frames - 1), any_pose(3), 10.0 * identity<6>(),
                             up_to(0, 1) ? 1.0 : std::numeric_limits<double>::infinity()});
    b.shared.free = up_to(0, 1) == 1;
    for (double& x : b.shared.weight.v) x = between(0, 10);
    for (Observation& seen : b.observations)
        for (double& x : seen.by_shared.v) x = b.shared.free ? between(-2, 2) : 0.0;
    if (up_to(0, 9) == 0) b.points[0][0] = std::nan("");
    return b;
}

bool same(const Bundle& a, const Bundle& b) {
    for (std::size_t k = 0; k < a.T_world_rig.size(); ++k)
        if (a.T_world_rig[k].R.v != b.T_world_rig[k].R.v || a.T_world_rig[k].t.v != b.T_world_rig[k].t.v)
            return false;
    return a.shared.value.v == b.shared.value.v;
}

}  // namespace

int main() {
    for (int round = 0; round < 300; ++round) {
        Bundle one = any_bundle(), three = one;
        const Adjustment done = adjust(one, 8, 1e-9, 1);
        adjust(three, 8, 1e-9, 3);
        if (done.cost > done.first_cost || !same(one, three)) {
            std::printf("round %d: the cost grew, or three threads differ from one\n", round);
            return 1;
        }
        std::vector<Vec3d> known = one.points;
        refine_pose(one.pinholes, any_pose(1), known, one.observations, 0.5, 15);
    }
    std::printf("bundles: no finding\n");
}
