// Python border of bundle adjustment and pose refinement: checks indices and shapes, releases the GIL.
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>

#include "bindings.hpp"
#include "bundle.hpp"
#include "pose.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using namespace facetcam;

template <class T, class Shape>
using Table = nb::ndarray<const T, Shape, nb::c_contig, nb::device::cpu>;
using Motions4 = Table<double, nb::shape<-1, 4, 4>>;
using Rows3 = Table<double, nb::shape<-1, 3>>;
using Rows2 = Table<double, nb::shape<-1, 2>>;
using Indices = Table<std::int64_t, nb::shape<-1>>;
using Pairs = Table<std::int64_t, nb::shape<-1, 2>>;
using Roots = Table<double, nb::shape<-1, 6, 6>>;
using ByShared = Table<double, nb::shape<-1, 2, kShared>>;
using SharedNumbers = Table<double, nb::shape<kShared>>;
using Flags = Table<bool, nb::shape<-1>>;
using Widths = Table<double, nb::shape<-1>>;
using Poses = nb::ndarray<nb::numpy, double, nb::ndim<3>>;
using Points = nb::ndarray<nb::numpy, double, nb::ndim<2>>;
using Numbers = nb::ndarray<nb::numpy, double, nb::ndim<1>>;

void require(bool right, const char* message) {
    if (!right) throw std::invalid_argument(message);
}

template <class Array>
void require_below(const Array& indices, std::size_t count, const char* message) {
    const std::int64_t* begin = indices.data();
    require(std::all_of(begin, begin + indices.size(),
                        [=](std::int64_t i) { return i >= 0 && i < static_cast<std::int64_t>(count); }),
            message);
}

std::vector<Rigid> rigid(const Motions4& T) {
    std::vector<Rigid> out(T.shape(0));
    for (std::size_t k = 0; k < out.size(); ++k)
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) out[k].R(i, j) = T(k, i, j);
            out[k].t[i] = T(k, i, 3);
        }
    return out;
}

Poses matrices(const std::vector<Rigid>& rigid) {
    std::vector<double> out(16 * rigid.size());
    for (std::size_t k = 0; k < rigid.size(); ++k) {
        double* T = out.data() + 16 * k;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) T[4 * i + j] = rigid[k].R(i, j);
            T[4 * i + 3] = rigid[k].t[i];
        }
        T[15] = 1.0;
    }
    return to_numpy<Poses>(std::move(out), {rigid.size(), 4, 4});
}

Points rows(const std::vector<Vec3d>& points) {
    std::vector<double> out;
    out.reserve(3 * points.size());
    for (const Vec3d& p : points) out.insert(out.end(), p.v.begin(), p.v.end());
    return to_numpy<Points>(std::move(out), {points.size(), 3});
}

Vec<kShared> numbers(const SharedNumbers& from) {
    Vec<kShared> out;
    std::copy_n(from.data(), kShared, out.v.begin());
    return out;
}

std::vector<Observation> observations(const Indices& frame, const Indices& view, const Indices& point,
                                      const Rows2& plane, const Rows2& edge) {
    std::vector<Observation> out(frame.size());
    for (std::size_t i = 0; i < out.size(); ++i)
        out[i] = {static_cast<int>(frame(i)),
                  static_cast<int>(view(i)),
                  static_cast<int>(point(i)),
                  plane(i, 0),
                  plane(i, 1),
                  {},
                  {{edge(i, 0), edge(i, 1)}}};
    return out;
}

std::vector<Motion> motions(const Pairs& between, const Motions4& T, const Roots& roots,
                            const Widths& loss_scales) {
    const std::vector<Rigid> measured = rigid(T);
    std::vector<Motion> out(between.shape(0));
    for (std::size_t k = 0; k < out.size(); ++k) {
        out[k] = {static_cast<int>(between(k, 0)),
                  static_cast<int>(between(k, 1)),
                  measured[k],
                  {},
                  loss_scales(k)};
        for (std::size_t i = 0; i < 36; ++i) out[k].root.v[i] = roots.data()[36 * k + i];
    }
    return out;
}

auto adjust_bundle(double focal, const Motions4& T_view_rig, const Motions4& T_world_rig, const Flags& fixed,
                   const Rows3& points, const Indices& frame, const Indices& view, const Indices& point,
                   const Rows2& plane, const Rows2& edge, const Pairs& between, const Motions4& T_i_j,
                   const Roots& roots, const Widths& motion_loss_scales, const ByShared& by_shared,
                   const SharedNumbers& shared, const SharedNumbers& shared_weight, double loss_scale,
                   int max_iterations, double tolerance, int threads) {
    const std::size_t n = frame.size(), m = between.shape(0);
    require(fixed.size() == T_world_rig.shape(0), "fixed: expected one flag a frame");
    require(view.size() == n && point.size() == n && plane.shape(0) == n && edge.shape(0) == n,
            "frame, view, point, plane, edge: expected one row an observation");
    require(T_i_j.shape(0) == m && roots.shape(0) == m && motion_loss_scales.size() == m,
            "between, T_i_j, roots, motion_loss_scales: expected one row a motion");
    const bool free = by_shared.shape(0) > 0;
    require(!free || by_shared.shape(0) == n, "by_shared: expected one row an observation, or none");
    require_below(frame, T_world_rig.shape(0), "frame: an index is out of range");
    require_below(view, T_view_rig.shape(0), "view: an index is out of range");
    require_below(point, points.shape(0), "point: an index is out of range");
    require_below(between, T_world_rig.shape(0), "between: an index is out of range");
    Bundle bundle{{focal, rigid(T_view_rig)},
                  rigid(T_world_rig),
                  {},
                  {},
                  observations(frame, view, point, plane, edge),
                  motions(between, T_i_j, roots, motion_loss_scales),
                  loss_scale,
                  {free, numbers(shared), numbers(shared_weight)}};
    for (std::size_t i = 0; i < by_shared.shape(0); ++i)
        std::copy_n(by_shared.data() + 2 * kShared * i, 2 * kShared,
                    bundle.observations[i].by_shared.v.begin());
    bundle.fixed.assign(fixed.data(), fixed.data() + fixed.size());
    for (std::size_t i = 0; i < points.shape(0); ++i)
        bundle.points.push_back({{points(i, 0), points(i, 1), points(i, 2)}});
    Adjustment done;
    {
        nb::gil_scoped_release release;
        done = adjust(bundle, max_iterations, tolerance, threads);
    }
    const auto& found = bundle.shared.value.v;
    return std::make_tuple(matrices(bundle.T_world_rig), rows(bundle.points),
                           to_numpy<Numbers>(std::vector<double>(found.begin(), found.end()), {kShared}),
                           done.first_cost, done.cost, done.iterations);
}

auto refined_pose(double focal, const Motions4& T_view_rig, const Motions4& T_world_rig, const Rows3& points,
                  const Indices& view, const Rows2& plane, const Rows2& edge, double sigma, int max_steps) {
    const std::size_t n = points.shape(0);
    require(T_world_rig.shape(0) == 1, "T_world_rig: expected one pose");
    require(view.size() == n && plane.shape(0) == n && edge.shape(0) == n,
            "points, view, plane, edge: expected one row an observation");
    require_below(view, T_view_rig.shape(0), "view: an index is out of range");
    const Pinholes pinholes{focal, rigid(T_view_rig)};
    std::vector<Vec3d> known(n);
    std::vector<Observation> seen(n);
    for (std::size_t i = 0; i < n; ++i) {
        known[i] = {{points(i, 0), points(i, 1), points(i, 2)}};
        seen[i] = {0,  static_cast<int>(view(i)), static_cast<int>(i), plane(i, 0), plane(i, 1),
                   {}, {{edge(i, 0), edge(i, 1)}}};
    }
    Rigid T = rigid(T_world_rig)[0];
    {
        nb::gil_scoped_release release;
        T = refine_pose(pinholes, T, known, seen, sigma, max_steps);
    }
    return matrices({T});
}

}  // namespace

void facetcam::bind_bundle(nb::module_& m) {
    m.def("adjust_bundle", &adjust_bundle, "focal"_a, "T_view_rig"_a.noconvert(), "T_world_rig"_a.noconvert(),
          "fixed"_a.noconvert(), "points"_a.noconvert(), "frame"_a.noconvert(), "view"_a.noconvert(),
          "point"_a.noconvert(), "plane"_a.noconvert(), "edge"_a.noconvert(), "between"_a.noconvert(),
          "T_i_j"_a.noconvert(), "roots"_a.noconvert(), "motion_loss_scales"_a.noconvert(),
          "by_shared"_a.noconvert(), "shared"_a.noconvert(), "shared_weight"_a.noconvert(), "loss_scale"_a,
          "max_iterations"_a, "tolerance"_a, "threads"_a,
          "Poses (K, 4, 4), points (P, 3) and shared numbers (3,) of least cost, the cost before and after, "
          "and the iterations.");
    m.def("refine_pose", &refined_pose, "focal"_a, "T_view_rig"_a.noconvert(), "T_world_rig"_a.noconvert(),
          "points"_a.noconvert(), "view"_a.noconvert(), "plane"_a.noconvert(), "edge"_a.noconvert(),
          "sigma"_a, "max_steps"_a, "Pose (1, 4, 4) that fits what was seen of known points.");
}
