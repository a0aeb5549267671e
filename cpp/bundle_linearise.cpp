#include <numeric>

#include "bundle_errors.hpp"
#include "bundle_system.hpp"
#include "parallel.hpp"

namespace facetcam {

double BundleSystem::cost() const {
    std::vector<double> losses(bundle_.points.size());
    over_points([&](int p) {
        for (int l = point_begin_[at(p)]; l < point_begin_[at(p) + 1]; ++l) {
            const Link& link = links_[at(l)];
            for (int i = link.begin; i < link.end; ++i)
                losses[at(p)] +=
                    sight_loss(bundle_.pinholes, T_rig_world_[at(link.frame)], bundle_.points[at(p)],
                               bundle_.observations[at(i)], bundle_.loss_scale);
        }
    });
    double sum = std::accumulate(losses.begin(), losses.end(), 0.0);
    for (const Motion& m : bundle_.motions)
        sum += motion_error(m, bundle_.T_world_rig[at(m.i)], bundle_.T_world_rig[at(m.j)]).loss.value;
    const auto& [free, value, weight] = bundle_.shared;
    for (int i = 0; free && i < kShared; ++i) sum += weight[i] * value[i] * value[i];
    return 0.5 * sum;
}

void BundleSystem::linearise() {
    over_points([this](int p) { linearise_point(p); });
    parallel_for(static_cast<int>(frames_.size()), threads_, [this](int row) { linearise_frame(row); });
    linearise_motions();
    if (bundle_.shared.free) linearise_shared();
}

void BundleSystem::linearise_point(int p) {
    Mat3 block;
    Vec3d gradient;
    Share share;
    for (int l = point_begin_[at(p)]; l < point_begin_[at(p) + 1]; ++l) {
        Link& link = links_[at(l)];
        Mat<6, 3> joint;
        for (int i = link.begin; i < link.end; ++i) {
            const SightError e =
                sight_error(bundle_.pinholes, T_rig_world_[at(link.frame)], bundle_.points[at(p)],
                            bundle_.observations[at(i)], bundle_.loss_scale);
            const Mat<2, 3> weighted = e.loss.weight * e.by_point;
            block += transposed_times(e.by_point, weighted);
            gradient += transposed_times(weighted, e.error);
            joint += transposed_times(e.by_frame, weighted);
            if (bundle_.shared.free) {
                const Mat<2, kShared>& by_shared = bundle_.observations[at(i)].by_shared;
                share.joint += transposed_times(by_shared, weighted);
                share.block += e.loss.weight * transposed_times(by_shared, by_shared);
                share.gradient += e.loss.weight * transposed_times(by_shared, e.error);
            }
        }
        link.joint = joint;
    }
    if (bundle_.shared.free) point_share_[at(p)] = share;
    point_block_[at(p)] = block;
    point_gradient_[at(p)] = gradient;
}

void BundleSystem::linearise_frame(int row) {
    const int frame = frames_[at(row)];
    Mat<6, 6> block;
    Vec<6> gradient;
    Mat<kShared, 6> shared;
    for (int k = frame_begin_[at(frame)]; k < frame_begin_[at(frame) + 1]; ++k) {
        const Link& link = links_[at(by_frame_[at(k)])];
        for (int i = link.begin; i < link.end; ++i) {
            const SightError e =
                sight_error(bundle_.pinholes, T_rig_world_[at(frame)], bundle_.points[at(link.point)],
                            bundle_.observations[at(i)], bundle_.loss_scale);
            const Mat<2, 6> weighted = e.loss.weight * e.by_frame;
            block += transposed_times(e.by_frame, weighted);
            gradient += transposed_times(weighted, e.error);
            if (bundle_.shared.free)
                shared += transposed_times(bundle_.observations[at(i)].by_shared, weighted);
        }
    }
    frame_block_[at(row)] = block;
    frame_gradient_[at(row)] = gradient;
    if (bundle_.shared.free) frame_shared_[at(row)] = shared;
}

void BundleSystem::linearise_motions() {
    joints_.clear();
    for (const Motion& m : bundle_.motions) {
        const MotionError e = motion_error(m, bundle_.T_world_rig[at(m.i)], bundle_.T_world_rig[at(m.j)]);
        const Mat<6, 6> by_i = e.loss.weight * e.by_i, by_j = e.loss.weight * e.by_j;
        const int i = row_of(m.i), j = row_of(m.j);
        if (i >= 0) {
            frame_block_[at(i)] += transposed_times(by_i, e.by_i);
            frame_gradient_[at(i)] += transposed_times(by_i, e.error);
        }
        if (j >= 0) {
            frame_block_[at(j)] += transposed_times(by_j, e.by_j);
            frame_gradient_[at(j)] += transposed_times(by_j, e.error);
        }
        if (i >= 0 && j > i) joints_.push_back({j, i, transposed_times(by_j, e.by_i)});
        if (j >= 0 && i > j) joints_.push_back({i, j, transposed_times(by_i, e.by_j)});
    }
}

void BundleSystem::linearise_shared() {
    shared_block_ = {};
    shared_gradient_ = {};
    const auto& [free, value, weight] = bundle_.shared;
    for (int i = 0; i < kShared; ++i) {
        shared_block_(i, i) = weight[i];
        shared_gradient_[i] = weight[i] * value[i];
    }
    for (const Share& share : point_share_) {
        shared_block_ += share.block;
        shared_gradient_ += share.gradient;
    }
}

}  // namespace facetcam
