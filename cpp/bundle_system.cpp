#include "bundle_system.hpp"

#include <algorithm>
#include <numeric>

#include "parallel.hpp"

namespace facetcam {

namespace {

constexpr int kPointsPerTask = 64;
constexpr double kFloor = 1e-9;  // keeps points and frames in place that nothing holds

// Where the runs of equal keys begin in a sorted list of them.
std::vector<int> run_begins(std::size_t n_keys, const std::vector<int>& keys) {
    std::vector<int> begin(n_keys + 1);
    for (const int key : keys) ++begin[at(key) + 1];
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    return begin;
}

template <int N>
Mat<N, N> damped(Mat<N, N> block, double damping) {
    for (int i = 0; i < N; ++i) block(i, i) += damping * block(i, i) + kFloor;
    return block;
}

template <int N>
double diagonal_product(const Mat<N, N>& block, const Vec<N>& step) {
    double sum = 0;
    for (int i = 0; i < N; ++i) sum += block(i, i) * step[i] * step[i];
    return sum;
}

}  // namespace

BundleSystem::BundleSystem(Bundle& bundle, int threads)
    : bundle_(bundle),
      threads_(threads),
      rows_(bundle.T_world_rig.size(), -1),
      point_block_(bundle.points.size()),
      point_inverse_(bundle.points.size()),
      point_gradient_(bundle.points.size()),
      point_step_(bundle.points.size()),
      system_({}) {
    for (std::size_t k = 0; k < bundle.T_world_rig.size(); ++k) {
        T_rig_world_.push_back(bundle.T_world_rig[k].inverse());
        if (bundle.fixed[k]) continue;
        rows_[k] = static_cast<int>(frames_.size());
        frames_.push_back(static_cast<int>(k));
    }
    frame_block_.resize(frames_.size());
    frame_gradient_.resize(frames_.size());
    frame_step_.resize(frames_.size());
    if (bundle.shared.free) {
        point_share_.resize(bundle.points.size());
        frame_shared_.resize(frames_.size());
    }
    sort_observations();
    shape_system();
}

void BundleSystem::sort_observations() {
    auto& seen = bundle_.observations;
    std::stable_sort(seen.begin(), seen.end(), [](const Observation& a, const Observation& b) {
        return a.point != b.point ? a.point < b.point : a.frame < b.frame;
    });
    std::vector<int> points, frames;
    for (int i = 0; i < static_cast<int>(seen.size()); ++i) {
        const Observation& o = seen[at(i)];
        if (links_.empty() || links_.back().point != o.point || links_.back().frame != o.frame) {
            links_.push_back({o.frame, o.point, i, i, {}});
            points.push_back(o.point);
            frames.push_back(o.frame);
        }
        links_.back().end = i + 1;
    }
    point_begin_ = run_begins(bundle_.points.size(), points);
    frame_begin_ = run_begins(bundle_.T_world_rig.size(), frames);
    by_frame_.resize(links_.size());
    std::iota(by_frame_.begin(), by_frame_.end(), 0);
    std::stable_sort(by_frame_.begin(), by_frame_.end(),
                     [&](int a, int b) { return frames[at(a)] < frames[at(b)]; });
}

// Frames are coupled by the points that they share, and by motions; shared numbers are a last block with all.
void BundleSystem::shape_system() {
    std::vector<int> first(frames_.size());
    std::iota(first.begin(), first.end(), 0);
    const auto couple = [&](int a, int b) {
        if (a < 0 || b < 0) return;
        int& begin = first[at(std::max(a, b))];
        begin = std::min(begin, std::min(a, b));
    };
    for (std::size_t p = 0; p < bundle_.points.size(); ++p) {
        int earliest = -1;
        for (int l = point_begin_[p]; l < point_begin_[p + 1]; ++l) {
            const int row = row_of(links_[at(l)].frame);
            if (earliest < 0) earliest = row;
            couple(earliest, row);
        }
    }
    for (const Motion& m : bundle_.motions) couple(row_of(m.i), row_of(m.j));
    if (bundle_.shared.free) first.push_back(0);
    system_ = Skyline(first);
    right_side_.resize(at(system_.rows()));
}

void BundleSystem::over_points(const std::function<void(int)>& task) const {
    const int count = static_cast<int>(bundle_.points.size());
    parallel_for((count + kPointsPerTask - 1) / kPointsPerTask, threads_, [&](int t) {
        const int end = std::min(count, (t + 1) * kPointsPerTask);
        for (int p = t * kPointsPerTask; p < end; ++p) task(p);
    });
}

template <int Rows, int Columns>
void BundleSystem::subtract(int row, int column, const Mat<Rows, Columns>& block) {
    for (int i = 0; i < Rows; ++i) {
        double* values = system_.row(6 * row + i) + 6 * column;
        for (int j = 0; j < Columns; ++j)
            if (6 * column + j <= 6 * row + i) values[j] -= block(i, j);
    }
}

// One row of blocks: the frame's own block, less what the points that it saw take away; and the block that
// it has with the shared numbers.
void BundleSystem::fill(int row, double damping) {
    const int frame = frames_[at(row)];
    const int shared = static_cast<int>(frames_.size());
    Vec<6> right = -1.0 * frame_gradient_[at(row)];
    subtract(row, row, -1.0 * damped(frame_block_[at(row)], damping));
    if (bundle_.shared.free) subtract(shared, row, -1.0 * frame_shared_[at(row)]);
    for (int k = frame_begin_[at(frame)]; k < frame_begin_[at(frame) + 1]; ++k) {
        const int own = by_frame_[at(k)];
        const Link& link = links_[at(own)];
        const Mat<6, 3> through = link.joint * point_inverse_[at(link.point)];
        right += through * point_gradient_[at(link.point)];
        if (bundle_.shared.free)
            subtract(shared, row, point_share_[at(link.point)].joint * transposed(through));
        for (int l = point_begin_[at(link.point)]; l <= own; ++l) {
            const Link& other = links_[at(l)];
            const int column = row_of(other.frame);
            if (column >= 0) subtract(row, column, through * transposed(other.joint));
        }
    }
    for (int i = 0; i < 6; ++i) right_side_[at(6 * row + i)] = right[i];
}

// The last row of blocks, of which the shared numbers fill a part.
void BundleSystem::fill_shared(double damping) {
    const int row = static_cast<int>(frames_.size());
    Mat<kShared, kShared> block = damped(shared_block_, damping);
    Vec<kShared> right = -1.0 * shared_gradient_;
    for (std::size_t p = 0; p < point_share_.size(); ++p) {
        const Mat<kShared, 3> through = point_share_[p].joint * point_inverse_[p];
        block -= through * transposed(point_share_[p].joint);
        right += through * point_gradient_[p];
    }
    subtract(row, row, -1.0 * block);
    for (int i = 0; i < Skyline::kBlock; ++i) {
        if (i >= kShared) system_.row(6 * row + i)[6 * row + i] = 1.0;
        right_side_[at(6 * row + i)] = i < kShared ? right[i] : 0.0;
    }
}

bool BundleSystem::solve(double damping) {
    over_points(
        [&](int p) { point_inverse_[at(p)] = inverse_symmetric(damped(point_block_[at(p)], damping)); });
    system_.clear();
    parallel_for(static_cast<int>(frames_.size()), threads_, [&](int row) { fill(row, damping); });
    for (const Joint& joint : joints_) subtract(joint.row, joint.column, -1.0 * joint.block);
    if (bundle_.shared.free) fill_shared(damping);
    if (!system_.factorise()) return false;
    system_.solve(right_side_.data());
    for (std::size_t row = 0; row < frames_.size(); ++row)
        std::copy_n(right_side_.begin() + static_cast<std::ptrdiff_t>(6 * row), 6,
                    frame_step_[row].v.begin());
    if (bundle_.shared.free)
        std::copy_n(right_side_.begin() + static_cast<std::ptrdiff_t>(6 * frames_.size()), kShared,
                    shared_step_.v.begin());
    over_points([&](int p) {
        Vec3d pull = point_gradient_[at(p)];
        if (bundle_.shared.free) pull += transposed_times(point_share_[at(p)].joint, shared_step_);
        for (int l = point_begin_[at(p)]; l < point_begin_[at(p) + 1]; ++l) {
            const int row = row_of(links_[at(l)].frame);
            if (row >= 0) pull += transposed_times(links_[at(l)].joint, frame_step_[at(row)]);
        }
        point_step_[at(p)] = -1.0 * (point_inverse_[at(p)] * pull);
    });
    return true;
}

double BundleSystem::promise(double damping) const {
    double sum = 0;
    for (std::size_t row = 0; row < frames_.size(); ++row)
        sum += damping * diagonal_product(frame_block_[row], frame_step_[row]) -
               dot(frame_gradient_[row], frame_step_[row]);
    for (std::size_t p = 0; p < point_step_.size(); ++p)
        sum += damping * diagonal_product(point_block_[p], point_step_[p]) -
               dot(point_gradient_[p], point_step_[p]);
    if (bundle_.shared.free)
        sum += damping * diagonal_product(shared_block_, shared_step_) - dot(shared_gradient_, shared_step_);
    return 0.5 * sum;
}

void BundleSystem::step() {
    for (std::size_t row = 0; row < frames_.size(); ++row) {
        Rigid& T = bundle_.T_world_rig[at(frames_[row])];
        T = T.moved(frame_step_[row]);
        T_rig_world_[at(frames_[row])] = T.inverse();
    }
    for (std::size_t p = 0; p < point_step_.size(); ++p) bundle_.points[p] += point_step_[p];
    if (bundle_.shared.free) move_shared(shared_step_);
}

// What was observed moves against the error.
void BundleSystem::move_shared(const Vec<kShared>& step) {
    bundle_.shared.value += step;
    for (Observation& seen : bundle_.observations) {
        const Vec<2> shift = seen.by_shared * step;
        seen.x -= shift[0];
        seen.y -= shift[1];
    }
}

void BundleSystem::place(const std::vector<Rigid>& T_world_rig, const std::vector<Vec3d>& points,
                         const Vec<kShared>& shared) {
    if (bundle_.shared.free) move_shared(shared - bundle_.shared.value);
    bundle_.T_world_rig = T_world_rig;
    bundle_.points = points;
    for (const int frame : frames_) T_rig_world_[at(frame)] = T_world_rig[at(frame)].inverse();
}

}  // namespace facetcam
