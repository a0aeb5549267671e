#include "bundle_errors.hpp"

namespace facetcam {

namespace {

template <int R, int C, int N>
void put(Mat<R, C>& into, int row, int column, const Mat<N, N>& block) {
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) into(row + i, column + j) = block(i, j);
}

// What counts of an error whose point may slide along its edge g.
Mat<2, 2> across(const Vec<2>& g) {
    return {{1.0 - g[0] * g[0], -g[0] * g[1], -g[0] * g[1], 1.0 - g[1] * g[1]}};
}

Loss behind(double focal, double loss_scale) { return {cauchy(focal * focal, loss_scale).value, 0.0}; }

}  // namespace

Loss cauchy(double squared, double scale) {
    if (!std::isfinite(scale)) return {squared, 1.0};
    const double s2 = scale * scale;
    return {s2 * std::log1p(squared / s2), s2 / (s2 + squared)};
}

double sight_loss(const Pinholes& pinholes, const Rigid& T_rig_world, const Vec3d& point,
                  const Observation& seen, double loss_scale) {
    const Vec3d local = pinholes.T_view_rig[static_cast<std::size_t>(seen.view)] * (T_rig_world * point);
    if (local[2] < kLeastDepth) return behind(pinholes.focal, loss_scale).value;
    const double s = pinholes.focal / local[2];
    const Vec<2> error = across(seen.edge) * Vec<2>{{s * local[0] - seen.x, s * local[1] - seen.y}};
    return cauchy(dot(error, error), loss_scale).value;
}

SightError sight_error(const Pinholes& pinholes, const Rigid& T_rig_world, const Vec3d& point,
                       const Observation& seen, double loss_scale) {
    const Rigid& T_view_rig = pinholes.T_view_rig[static_cast<std::size_t>(seen.view)];
    const Vec3d in_rig = T_rig_world * point, local = T_view_rig * in_rig;
    SightError out{};
    if (local[2] < kLeastDepth) {
        out.loss = behind(pinholes.focal, loss_scale);
        return out;
    }
    const double s = pinholes.focal / local[2], x = s * local[0], y = s * local[1];
    const Mat<2, 2> counts = across(seen.edge);
    out.error = counts * Vec<2>{{x - seen.x, y - seen.y}};
    const Mat<2, 3> by_local{{s, 0, -x / local[2], 0, s, -y / local[2]}};
    const Mat<2, 3> by_rig = counts * by_local * T_view_rig.R;
    out.by_point = by_rig * T_rig_world.R;
    const Mat<2, 3> by_turn = by_rig * skew(in_rig);  // the point moves against the rig
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j) {
            out.by_frame(i, j) = by_turn(i, j);
            out.by_frame(i, j + 3) = -by_rig(i, j);
        }
    out.loss = cauchy(dot(out.error, out.error), loss_scale);
    return out;
}

MotionError motion_error(const Motion& motion, const Rigid& T_world_i, const Rigid& T_world_j) {
    const Rigid T_j_i = motion.T_i_j.inverse(), E = T_j_i * (T_world_i.inverse() * T_world_j);
    const Vec3d phi = rotation_vector(E.R);
    const Mat3 right = inverse_right_jacobian(phi), left = transposed(right);
    Mat<6, 6> by_i, by_j;
    put(by_j, 0, 0, right);
    put(by_j, 3, 3, E.R);
    // A twist of frame i acts on E from the left, seen through the measured motion.
    put(by_i, 0, 0, -1.0 * (left * T_j_i.R));
    put(by_i, 3, 3, -1.0 * T_j_i.R);
    put(by_i, 3, 0, skew(E.t) * T_j_i.R - skew(T_j_i.t) * T_j_i.R);
    MotionError out{};
    out.error = motion.root * Vec<6>{{phi[0], phi[1], phi[2], E.t[0], E.t[1], E.t[2]}};
    out.by_i = motion.root * by_i;
    out.by_j = motion.root * by_j;
    out.loss = cauchy(dot(out.error, out.error), motion.loss_scale);
    return out;
}

}  // namespace facetcam
