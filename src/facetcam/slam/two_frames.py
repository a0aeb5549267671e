"""Two frames: their matching corners, and the motion between them from the images alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from facetcam.features import match_windowed
from facetcam.geometry import se3
from facetcam.geometry.triangulation import triangulate_two_rays
from facetcam.slam.config import SlamConfig
from facetcam.slam.epipolar import epipolar_error, match_along_epipolars
from facetcam.slam.frame import Corners
from facetcam.slam.optics import Optics

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_MATCHES = 60
START_GATE = 8.0  # px: odometry and the first guess of the scale are rough
_SEARCH = 0.3  # of the frame's width
_START_PARALLAX = 0.02  # radians
_CLEAR_PARALLAX = 0.01  # radians that a pure rotation cannot explain
_CLEAR_SHARE = 0.4  # of the pairs that must show it
_ROTATION_STEPS = 10
_UNKNOWN_DEPTH = 3.0  # metres: the median depth of a scene whose scale the images cannot tell
_LENGTHS = np.geomspace(0.25, 4.0, 17)
_EPIPOLAR_GATE = 2.0  # px
_EPIPOLAR_SIGMA = 0.5  # px
_TWIST_STEP = 1e-6  # radians, metres
_LENGTH_PRIOR = 3.0
_FITTING = 0.8  # share of the matches that the right motion explains
_MIN_VIEW_MATCHES = 20
_STANDING = 1e-4  # metres
_MIN_CONFIRMING = 40  # pairs
_CONFIRMING = 0.6  # share of them
_MOST_TURNED = 0.2  # radians by which the images may correct a motion measured otherwise
_MOST_STRETCHED = 2.0  # factor of its length


@dataclass(slots=True)
class Pairs:
    """Corners of two frames taken for the same points: view, and position on its ideal pinhole in both."""

    views: NDArray[np.int8]
    plane_a: Array
    plane_b: Array

    @classmethod
    def of(cls, a: Corners, rows_a: Index, b: Corners, rows_b: Index) -> Pairs:
        """Pairs of corner rows."""
        return cls(a.views[rows_a], a.plane[rows_a], b.plane[rows_b])

    def __len__(self) -> int:
        return len(self.views)

    def epipolar_errors(self, T_a_b: Array, optics: Optics) -> Array:
        """Signed Sampson distances (N,) in pixels from a motion of the rig; (K, N) for K motions."""
        error = np.empty((*T_a_b.shape[:-2], len(self)))
        for view in np.unique(self.views):
            rows = self.views == view
            error[..., rows] = epipolar_error(
                self.plane_a[rows], self.plane_b[rows], int(view), T_a_b, optics
            )
        return error

    def parallax(self, T_a_b: Array, optics: Optics) -> tuple[Array, Array]:
        """Distance (N,) from frame a, negative where rays part, and angle (N,) between the rays."""
        origins = optics.origins(self.views)
        rays_a, rays_b = (optics.plane_rays(p, self.views) for p in (self.plane_a, self.plane_b))
        _, distance, other, angle = triangulate_two_rays(
            origins, rays_a, se3.transform(T_a_b, origins), rays_b @ T_a_b[:3, :3].T
        )
        return np.where(other > 0, distance, -1.0), angle

    def pure_rotation(self, optics: Optics) -> tuple[Array, Array]:
        """Best rotation (3, 3) of the rig on the spot, and the angles (N,) it leaves between the rays."""
        a, b = (optics.plane_rays(p, self.views) for p in (self.plane_a, self.plane_b))
        weight = np.ones(len(a))
        for _ in range(_ROTATION_STEPS):
            rotation, _ = Rotation.align_vectors(a, b, weights=weight)
            angle = np.linalg.norm(np.cross(a, rotation.apply(b)), axis=1)
            weight = 1.0 / (1.0 + (angle / _CLEAR_PARALLAX) ** 2)
        return rotation.as_matrix(), angle

    def count_good(self, T_a_b: Array, optics: Optics, gate: float) -> Index:
        """Pairs of each view that fit a motion, lie in front of the view and have parallax."""
        distance, angle = self.parallax(T_a_b, optics)
        fits = np.abs(self.epipolar_errors(T_a_b, optics)) < gate
        good = self.views[fits & (distance > 0) & (angle > _START_PARALLAX)]
        return np.bincount(good, minlength=optics.n_views)


def match_corners(a: Corners, b: Corners, config: SlamConfig) -> Pairs:
    """Corners of two frames that look alike, in the same view and not far from each other on it."""
    hits = match_windowed(
        a.descriptors,
        a.pixels,
        a.views,
        b.descriptors,
        b.pixels,
        b.views,
        radius=_SEARCH * float(np.ptp(a.pixels[:, 0])) if len(a) else 0.0,
        max_distance=config.match_distance,
        ratio=config.match_ratio,
    )
    rows = np.flatnonzero(hits >= 0)
    return Pairs.of(a, rows, b, hits[rows].astype(np.int64))


def enough_parallax(a: Corners, b: Corners, T_a_b: Array, optics: Optics, config: SlamConfig) -> bool:
    """Tell whether two frames with a known motion can start a map."""
    rows = match_along_epipolars(
        a, np.arange(len(a)), b, np.arange(len(b)), T_a_b, START_GATE, optics, config
    )
    return bool(Pairs.of(a, rows[0], b, rows[1]).count_good(T_a_b, optics, START_GATE).sum() >= MIN_MATCHES)


def estimate_motion(pairs: Pairs, optics: Optics) -> Array | None:
    """Motion `T_a_b` between two frames from their corners alone, or None where they cannot tell.

    Each view proposes a rotation and a direction (PoseLib, five points), to which the length is added with
    which all views agree best; the proposal that explains most pairs of all views wins.
    """
    if len(pairs) < MIN_MATCHES:
        return None
    if np.mean(pairs.pure_rotation(optics)[1] > _CLEAR_PARALLAX) < _CLEAR_SHARE:
        return None  # a turn on the spot, or too small a step to tell from one
    best = joint_motion(pairs, view_motions(pairs, optics), optics)
    if best is None:
        return None
    share = float(np.mean(np.abs(pairs.epipolar_errors(best, optics)) < _EPIPOLAR_GATE))
    good = pairs.count_good(best, optics, _EPIPOLAR_GATE)
    # A wall close to one view is a plane, which leaves the motion ambiguous: another view must bear it out.
    several = np.sum(np.bincount(pairs.views) >= _MIN_VIEW_MATCHES) > 1
    borne_out = not several or good.sum() - good.max() >= _MIN_VIEW_MATCHES
    return best if share > _FITTING and good.sum() >= MIN_MATCHES and borne_out else None


def confirmed_motion(pairs: Pairs, T_a_b: Array, optics: Optics) -> Array | None:
    """Motion that was measured otherwise, turned as the images say; None where they say something else.

    Wheels may slip and their clock be off: only the length is theirs. Few pairs can neither confirm nor deny.
    """
    if len(pairs) < _MIN_CONFIRMING or np.linalg.norm(T_a_b[:3, 3]) < _STANDING:
        return T_a_b
    on_the_spot = se3.from_rotation_translation(pairs.pure_rotation(optics)[0], T_a_b[:3, 3])
    proposals = [_polished(T, pairs, optics) for T in (T_a_b, on_the_spot)]
    shares = [float(np.mean(np.abs(pairs.epipolar_errors(T, optics)) < _EPIPOLAR_GATE)) for T in proposals]
    best = proposals[int(np.argmax(shares))]
    return best if max(shares) > _CONFIRMING and _much_alike(best, T_a_b) else None


def _much_alike(T: Array, T_measured: Array) -> bool:
    """False where the images would correct a motion so far that they rather deny it."""
    turned = float(np.linalg.norm(se3.log(se3.inverse(T_measured) @ T)[:3]))
    stretched = float(np.linalg.norm(T[:3, 3]) / np.linalg.norm(T_measured[:3, 3]))
    return turned < _MOST_TURNED and 1.0 / _MOST_STRETCHED < stretched < _MOST_STRETCHED


def view_motions(pairs: Pairs, optics: Optics) -> dict[int, Array]:
    """Motion of each view's pinhole by itself, of unit length, for the views with enough pairs."""
    motions = {int(v): _view_motion(pairs, int(v), optics) for v in np.unique(pairs.views)}
    return {v: T for v, T in motions.items() if T is not None}


def joint_motion(pairs: Pairs, proposals: dict[int, Array], optics: Optics) -> Array | None:
    """Motion of the rig that explains most pairs of all views, from what single views propose."""
    best, most = None, 0
    for view, proposal in proposals.items():
        T = _with_length(proposal, view, pairs, optics)
        fits = int(np.sum(np.abs(pairs.epipolar_errors(T, optics)) < _EPIPOLAR_GATE))
        if fits > most:
            best, most = T, fits
    return None if best is None else _polished(best, pairs, optics)


def _polished(T_a_b: Array, pairs: Pairs, optics: Optics) -> Array:
    """Least epipolar errors of all views together, length included as far as the pairs determine it."""
    length = float(np.linalg.norm(T_a_b[:3, 3]))

    def residuals(twists: Array) -> Array:
        T = T_a_b @ se3.exp(twists)
        stretch = np.log(np.maximum(np.linalg.norm(T[..., :3, 3], axis=-1), 1e-9) / length)
        return np.concatenate([pairs.epipolar_errors(T, optics), _LENGTH_PRIOR * stretch[..., None]], axis=-1)

    def jacobian(twist: Array) -> Array:
        moved = residuals(twist + _TWIST_STEP * np.concatenate([np.eye(6), -np.eye(6)]))
        return np.asarray((moved[:6] - moved[6:]).T / (2.0 * _TWIST_STEP))

    solution = least_squares(
        residuals, np.zeros(6), jacobian, loss="cauchy", f_scale=_EPIPOLAR_SIGMA, max_nfev=30
    )
    return T_a_b @ se3.exp(solution.x)


def _view_motion(pairs: Pairs, view: int, optics: Optics) -> Array | None:
    """Motion of one view's pinhole with a translation of length one."""
    import poselib

    rows = pairs.views == view
    if rows.sum() < _MIN_VIEW_MATCHES:
        return None
    camera = {"model": "SIMPLE_PINHOLE", "width": 1, "height": 1, "params": [optics.focal, 0.0, 0.0]}
    pose, _ = poselib.estimate_relative_pose(
        pairs.plane_a[rows],
        pairs.plane_b[rows],
        camera,
        camera,
        {"max_epipolar_error": 1.0, "min_iterations": 200, "max_iterations": 2000, "seed": 0},
        {},
    )
    length = float(np.linalg.norm(pose.t))
    if not length > 1e-9:
        return None
    # PoseLib's last digits change from call to call, and with them all that follows.
    return np.round(se3.inverse(se3.from_rotation_translation(pose.R, pose.t / length)), 9)


def _with_length(T_unit: Array, view: int, pairs: Pairs, optics: Optics) -> Array:
    """Motion of the rig from that of one view, with the length that suits all views."""

    def rig_motion(length: float) -> Array:
        T = T_unit.copy()
        T[:3, 3] *= length
        return np.asarray(optics.T_rig_view[view] @ T @ optics.T_view_rig[view])

    distance, _ = pairs.parallax(rig_motion(1.0), optics)
    ahead = distance[(distance > 0) & (distance < 1e3)]
    usual = _UNKNOWN_DEPTH / max(float(np.median(ahead)), 1e-6) if len(ahead) else 1.0
    best, best_cost = rig_motion(usual), np.inf
    usual_first = _LENGTHS[np.argsort(np.abs(np.log(_LENGTHS)), kind="stable")]
    motions = np.stack([rig_motion(usual * float(factor)) for factor in usual_first])
    errors = np.abs(pairs.epipolar_errors(motions, optics))
    for T, cost in zip(motions, np.minimum(errors, _EPIPOLAR_GATE).mean(axis=1)):
        if cost < 0.98 * best_cost:  # a flat cost keeps the usual length
            best, best_cost = T, cost
    return best
