"""Bundle adjustment by Ceres with the cost functions of COLMAP: the peer of the native one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.adjustment.bundle import Bundle
from facetcam.slam.camera.optics import Optics

Array = NDArray[np.float64]

_UNIT_STIFFNESS = 1e5


def ceres_adjust(
    bundle: Bundle, optics: Optics, loss_scale: float, max_iterations: int, tolerance: float
) -> tuple[Array, Array]:
    """As `facetcam.slam.adjustment.bundle.adjust`; the losses of motions are left out."""
    import pyceres

    problem = pyceres.Problem()
    poses = [_pose_block(T) for T in bundle.T_world_rig]
    points = bundle.points.copy()
    _add_reprojections(problem, bundle, optics, poses, list(points), pyceres.CauchyLoss(loss_scale))
    _add_motions(problem, bundle, poses)
    _tie_poses(problem, bundle, poses, pyceres)
    pyceres.solve(_solver_options(max_iterations, tolerance, pyceres), problem, pyceres.SolverSummary())
    T_world_rig = bundle.T_world_rig.copy()
    for k in np.flatnonzero(~bundle.fixed):
        T_world_rig[k] = se3.inverse(se3.from_quaternion_xyzw(poses[k][:4], poses[k][4:]))
    return T_world_rig, points


def _solver_options(max_iterations: int, tolerance: float, pyceres: Any) -> Any:
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.SPARSE_SCHUR
    options.max_num_iterations = max_iterations
    options.function_tolerance = tolerance
    options.logging_type = pyceres.LoggingType.SILENT
    # One thread: the sums are then made in one order, and every run gives the same result.
    options.num_threads = 1
    return options


def _pose_block(T_world_rig: Array) -> Array:
    """Parameters (qx, qy, qz, qw, tx, ty, tz) of rig-from-world, as COLMAP's cost functions take them."""
    T_rig_world = se3.inverse(T_world_rig)
    return np.concatenate([se3.to_quaternion_xyzw(T_rig_world), T_rig_world[:3, 3]])


def _add_reprojections(
    problem: Any, bundle: Bundle, optics: Optics, poses: list[Array], points: list[Array], loss: Any
) -> None:
    import pycolmap
    from pycolmap.cost_functions import RigReprojErrorCost

    model = pycolmap.CameraModelId.SIMPLE_PINHOLE
    pinhole = np.array([optics.focal, 0.0, 0.0])
    view_from_rig = [_rigid(T) for T in optics.T_view_rig]
    for k, v, p, seen in zip(
        bundle.frame.tolist(), bundle.view.tolist(), bundle.point.tolist(), bundle.plane
    ):
        cost = RigReprojErrorCost(model, seen, view_from_rig[v])
        problem.add_residual_block(cost, loss, [points[p], poses[k], pinhole])
    problem.set_parameter_block_constant(pinhole)


def _add_motions(problem: Any, bundle: Bundle, poses: list[Array]) -> None:
    from pycolmap.cost_functions import RelativePosePriorCost

    for motion in bundle.motions:
        cost = RelativePosePriorCost(motion.covariance, _rigid(motion.T_i_j))
        problem.add_residual_block(cost, None, [poses[motion.i], poses[motion.j]])


def _tie_poses(problem: Any, bundle: Bundle, poses: list[Array], pyceres: Any) -> None:
    """Hold the fixed poses, and the quaternions of the free ones at unit length.

    COLMAP's block joins quaternion and translation, for which pyceres has no manifold; a stiff residual
    stands in for it.
    """

    class UnitQuaternion(pyceres.CostFunction):
        def __init__(self) -> None:
            super().__init__()
            self.set_num_residuals(1)
            self.set_parameter_block_sizes([7])

        def Evaluate(self, parameters: Any, residuals: Any, jacobians: Any) -> bool:
            q = parameters[0][:4]
            residuals[0] = _UNIT_STIFFNESS * (q @ q - 1.0)
            if jacobians is not None and jacobians[0] is not None:
                jacobians[0][:] = 0.0
                jacobians[0][:4] = 2.0 * _UNIT_STIFFNESS * q
            return True

    unit = UnitQuaternion()
    for pose, fixed in zip(poses, bundle.fixed):
        if not problem.has_parameter_block(pose):
            continue
        if fixed:
            problem.set_parameter_block_constant(pose)
        else:
            problem.add_residual_block(unit, None, [pose])


def _rigid(T: Array) -> Any:
    import pycolmap

    se3.assert_proper_rotation(T[:3, :3], "pose for bundle adjustment", 1e-5)
    return pycolmap.Rigid3d(pycolmap.Rotation3d(T[:3, :3]), T[:3, 3])
