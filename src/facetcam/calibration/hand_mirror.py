"""Where a board stands that the camera sees only in a mirror held by hand.

Camera and board stand still, the mirror moves. The images of the board are reflections S_i T_cam_board; two
of them differ by the rotation S_i S_j about the line in which the mirrors meet. A mirror's normal is across
all its lines; three poses that do not share one line fix the board (Sturm and Bonfort 2006, "How to compute
the pose of an object without a direct view?"; Rodrigues, Barreto and Nunes 2010).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.calibration import lens
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.bootstrap import T_RIG_CAM
from facetcam.calibration.chessboards import placements
from facetcam.calibration.fit import Fit, Tolerance
from facetcam.calibration.plane_pose import plane_pose
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import settled, started
from facetcam.errors import FacetcamError
from facetcam.geometry import reflection, se3
from facetcam.rig import Camera, Mirror, Rig, View

Array = NDArray[np.float64]

_LEAST_ANGLE = np.radians(0.1)  # between mirrors, across the plane of the other two
_TRIES = 12  # normals tried across nearly one axis
_DISTINCT = 0.05  # difference of rotations from which starts are two
_FOLLOWED = 4  # starts that are adjusted
_IMPOSSIBLE = 10.0
_DISTORTION = ("k1", "k2")


@dataclass(frozen=True, eq=False)
class HandMirror:
    """A board seen in a moving mirror, solved.

    Attributes
    ----------
    T_cam_board : (4, 4) array
    rig : Rig
        The camera with the distortion found, and the mirror in each of its poses as mirror `pose1`, `pose2`
        ... in the order of the sightings; the rig frame is the camera's, with z up.
    rms : float
        Pixels, of the corners kept.
    fit : Fit
    """

    T_cam_board: Array
    rig: Rig
    rms: float
    fit: Fit

    @property
    def pose_rms(self) -> Array:
        """RMS (N,) of the corners kept of each pose of the mirror, pixels; NaN where none is kept."""
        out = np.full(len(self.fit.sightings), np.nan)
        for i, (a, b) in enumerate(self.fit.looks.bounds):
            off = self.fit.residuals[a:b][self.fit.kept[a:b]]
            out[i] = np.sqrt(np.mean(np.sum(off**2, axis=1))) if len(off) else np.nan
        return out


def solve_hand_mirror(board: Board, sightings: Sequence[Sighting], camera: Camera) -> HandMirror:
    """Pose of a board that is seen only in a mirror, from three or more poses of the mirror.

    Parameters
    ----------
    board : Board
    sightings : sequence of Sighting
        One a pose of the mirror. What the pattern leaves open is read as mirrored.
    camera : Camera
        Focal lengths and principal point, which are kept; the radial distortion is estimated.

    Raises
    ------
    FacetcamError
        If there are fewer than three poses, or all mirrors meet in one line.
    """
    mirrored = [_mirrored(s, board, i) for i, s in enumerate(sightings)]
    if len(mirrored) < 3:
        raise FacetcamError(
            f"hand-held mirror: {len(mirrored)} of its poses seen; the board's place takes three or more"
        )
    images = np.array([_image(camera, board, s) for s in mirrored])
    names = [f"pose{i + 1}" for i in range(len(mirrored))]
    # All poses are taken as mirrors of one photo: camera and board did not move.
    seen = [replace(s, photo=0, board=0, view=name) for s, name in zip(mirrored, names)]
    tries = [_adjusted(board, seen, _rig(camera, images, T), camera) for T in _starts(images)]
    fit = min(tries, key=_rms)
    return _found(fit)


def solve_without(found: HandMirror, board: Board, camera: Camera, left_out: Collection[int]) -> HandMirror:
    """The same from fewer poses of the mirror, starting from what all of them gave."""
    seen = [s for i, s in enumerate(found.fit.sightings) if i not in left_out]
    return _found(_adjusted(board, seen, replace(found.rig, camera=camera), camera))


def _found(fit: Fit) -> HandMirror:
    T_rig_board = fit.state.T_rig_station[0] @ fit.state.T_station_board[0]
    return HandMirror(se3.inverse(T_RIG_CAM) @ T_rig_board, fit.rig, _rms(fit), fit)


def _mirrored(sighting: Sighting, board: Board, index: int) -> Sighting:
    ways = placements(sighting, board, True) if sighting.mirrored is None else [sighting]
    if not ways or not ways[0].mirrored:
        raise FacetcamError(
            f"hand-held mirror: sighting {index + 1} shows the board directly, not in a mirror; leave it out"
        )
    if len(ways) > 1:
        raise FacetcamError(
            f"hand-held mirror: sighting {index + 1} can be read in {len(ways)} ways; take a board with"
            " an even number of squares one way and an odd number the other, wholly seen"
        )
    return ways[0]


def _image(camera: Camera, board: Board, sighting: Sighting) -> Array:
    """Signed pose (4, 4) of the board's image, of determinant -1."""
    rays = camera.ray(sighting.pixels)
    T = plane_pose(board.points[sighting.corners], rays[:, :2] / rays[:, 2:])
    if T is None:
        raise FacetcamError(
            "hand-held mirror: no place of the board explains a photo; check its squares in boards.yaml"
        )
    T[:3, 2] *= -1.0
    return T


def _starts(images: Array) -> list[Array]:
    """The likeliest T_cam_board, as each pose of the mirror tells it.

    A normal is across the axes by which its image is turned against the others; where these are nearly one
    axis, any normal across it is tried.
    """
    starts, spread = [], 0.0
    for i in range(len(images)):
        turns = Rotation.from_matrix(
            [images[i, :3, :3] @ T[:3, :3].T for j, T in enumerate(images) if j != i]
        )
        values, vectors = np.linalg.eigh(np.einsum("ij,ik->jk", turns.as_rotvec(), turns.as_rotvec()))
        spread = max(spread, float(values[1]))
        for angle in np.arange(_TRIES) * np.pi / _TRIES:
            normal = np.cos(angle) * vectors[:, 0] + np.sin(angle) * vectors[:, 1]
            turned = reflection.reflection(normal, 0.0)[:3, :3] @ images[i, :3, :3]
            starts.append(_placed(images, turned))
    if spread < (2.0 * _LEAST_ANGLE) ** 2:
        raise FacetcamError(
            "hand-held mirror: its poses all meet in one line, which leaves the board's place open;"
            " tilt the mirror about two axes"
        )
    starts.sort(key=lambda T: _disagreement(images, T))
    chosen: list[Array] = []
    for T in starts:
        if all(np.linalg.norm(T[:3, :3] - other[:3, :3]) > _DISTINCT for other in chosen):
            chosen.append(T)
    return chosen[:_FOLLOWED]


def _disagreement(images: Array, T: Array) -> float:
    """How badly mirrors explain the images with the board at T; it cannot be behind a mirror."""
    total = 0.0
    for normal, image in zip(_normals(images, T[:3, :3]), images):
        offset = 0.5 * float(normal @ (image[:3, 3] - T[:3, 3]) + 2.0 * (normal @ T[:3, 3]))
        off = reflection.reflection(normal, offset) @ T - image
        total += float(np.sum(off[:3, :3] ** 2) + np.sum(off[:3, 3] ** 2) / np.sum(image[:3, 3] ** 2))
        behind = offset * (offset - normal @ T[:3, 3]) < 0
        total += _IMPOSSIBLE if behind else 0.0
    return total


def _placed(images: Array, turned: Array) -> Array:
    """T_cam_board with a given rotation (3, 3), the shift by linear least squares over all mirrors."""
    count = len(images)
    A, b = np.zeros((3 * count, 3 + count)), images[:, :3, 3].ravel()
    for i, normal in enumerate(_normals(images, turned)):
        A[3 * i : 3 * i + 3, :3] = np.eye(3) - 2.0 * np.outer(normal, normal)
        A[3 * i : 3 * i + 3, 3 + i] = 2.0 * normal
    return se3.from_rotation_translation(turned, np.linalg.lstsq(A, b, rcond=None)[0][:3])


def _normals(images: Array, turned: Array) -> Array:
    """Normals (N, 3) of the mirrors that turn the board as seen: S = I - 2 n n'."""
    out = [np.linalg.eigh(0.5 * (M + M.T))[1][:, 0] for M in images[:, :3, :3] @ turned.T]
    return np.array(out)


def _rig(camera: Camera, images: Array, T_cam_board: Array) -> Rig:
    mirrors, views = {}, {}
    for i, (normal, T) in enumerate(zip(_normals(images, T_cam_board[:3, :3]), images), start=1):
        reflected = T_cam_board[:3, 3] - 2.0 * (normal @ T_cam_board[:3, 3]) * normal
        offset = 0.5 * float(normal @ (T[:3, 3] - reflected))
        sign = 1.0 if offset >= 0 else -1.0
        mirrors[f"pose{i}"] = Mirror.from_plane(f"pose{i}", T_RIG_CAM[:3, :3] @ normal * sign, offset * sign)
        views[f"pose{i}"] = View((f"pose{i}",))
    return Rig(camera, T_RIG_CAM, mirrors, views)


def _adjusted(board: Board, seen: Sequence[Sighting], rig: Rig, camera: Camera) -> Fit:
    """Board, mirrors and radial distortion together."""
    tolerance = Tolerance(tilt=float(np.radians(20.0)), shift=0.5)
    fit = started(rig, BoardSet((board,)), seen, tolerance)
    names = lens.NAMES[camera.model]
    free = fit.free.copy()
    free[: len(names)] = [name in _DISTORTION for name in names]
    return settled(replace(fit, free=free, state=replace(fit.state, intrinsics=lens.values_of(camera))))


def _rms(fit: Fit) -> float:
    return float(np.sqrt(np.mean(np.sum(fit.residuals[fit.kept] ** 2, axis=1))))
