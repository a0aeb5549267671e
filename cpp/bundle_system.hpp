// The normal equations of a bundle: linearised, points eliminated (Schur complement), solved for a step.
#pragma once
#include <functional>

#include "bundle.hpp"
#include "skyline.hpp"

namespace facetcam {

inline std::size_t at(int index) { return static_cast<std::size_t>(index); }

// Every block is summed by one task in the order of the observations, whatever the number of threads.
class BundleSystem {
 public:
    // Sorts the bundle's observations by point and frame.
    BundleSystem(Bundle& bundle, int threads);

    double cost() const;
    void linearise();
    // Finds the step at some damping; false where there is none.
    bool solve(double damping);
    // Decrease of the cost that the linearised problem promises for the step.
    double promise(double damping) const;
    // Moves poses, points and shared numbers by the step.
    void step();
    // Puts others in place.
    void place(const std::vector<Rigid>& T_world_rig, const std::vector<Vec3d>& points,
               const Vec<kShared>& shared);

 private:
    // The observations that one frame made of one point, and their block in the normal equations.
    struct Link {
        int frame, point, begin, end;
        Mat<6, 3> joint;
    };
    // What the observations of one point say of the shared numbers.
    struct Share {
        Mat<kShared, 3> joint;
        Mat<kShared, kShared> block;
        Vec<kShared> gradient;
    };
    // A block that a motion puts between two frames.
    struct Joint {
        int row, column;
        Mat<6, 6> block;
    };

    void sort_observations();
    void shape_system();
    void linearise_point(int point);
    void linearise_frame(int row);
    void linearise_motions();
    void linearise_shared();
    void fill(int row, double damping);
    void fill_shared(double damping);
    template <int Rows, int Columns>
    void subtract(int row, int column, const Mat<Rows, Columns>& block);
    void move_shared(const Vec<kShared>& step);
    void over_points(const std::function<void(int)>& task) const;
    int row_of(int frame) const { return rows_[static_cast<std::size_t>(frame)]; }

    Bundle& bundle_;
    const int threads_;
    std::vector<Rigid> T_rig_world_;
    std::vector<int> rows_;                    // of frames in the system, -1 where fixed
    std::vector<int> frames_;                  // of rows
    std::vector<Link> links_;                  // by point, then frame
    std::vector<int> point_begin_;             // into links_
    std::vector<int> by_frame_, frame_begin_;  // links of each frame
    std::vector<Mat<6, 6>> frame_block_;
    std::vector<Vec<6>> frame_gradient_, frame_step_;
    std::vector<Mat3> point_block_, point_inverse_;
    std::vector<Vec3d> point_gradient_, point_step_;
    std::vector<Joint> joints_;
    std::vector<Share> point_share_;             // empty where the shared numbers are held
    std::vector<Mat<kShared, 6>> frame_shared_;  // their blocks with the frames
    Mat<kShared, kShared> shared_block_;
    Vec<kShared> shared_gradient_, shared_step_;
    Skyline system_;
    std::vector<double> right_side_;
};

}  // namespace facetcam
