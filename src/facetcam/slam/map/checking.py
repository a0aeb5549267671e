"""What the arrays of a map must be, before anything is made of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.features.descriptors import DESCRIPTOR_BYTES
from facetcam.geometry import se3
from facetcam.slam.map.points import Points

Array = NDArray[Any]
Arrays = dict[str, NDArray[Any]]

_ROWS: dict[str, tuple[tuple[int, ...], str]] = {  # shape of a row, and kind of number
    "camera.creep": ((), "f"),
    "keyframes.timestamp": ((), "f"),
    "keyframes.T_world_rig": ((4, 4), "f"),
    "keyframes.odometry": ((3,), "f"),
    "keyframes.measured": ((), "i"),
    "keyframes.session": ((), "i"),
    "keyframes.velocity": ((6,), "f"),
    "observations.keyframe": ((), "i"),
    "observations.point": ((), "i"),
    "observations.view": ((), "i"),
    "observations.pixels": ((2,), "f"),
    "sightings.keyframe": ((), "i"),
    "sightings.point": ((), "i"),
    "sightings.descriptor": ((DESCRIPTOR_BYTES,), "u"),
}
_MAY_BE_ABSENT = ("keyframes.odometry",)  # in rows of NaN
_CENTRAL = 1.0  # px from the middle of its patch to a point, at most


def check(arrays: Arrays, points: Points, n_views: int) -> None:
    """Compare arrays with what those of a rig of so many views, and such `points`, look like.

    Raises
    ------
    ValueError
        With the first part that cannot be one of a map.
    """
    for name, array in arrays.items():
        _check_rows(name, array, points)
    n_points, n_keyframes = len(arrays["points.xyz"]), len(arrays["keyframes.timestamp"])
    for table in ("observations", "sightings"):
        _check_range(arrays[f"{table}.point"], n_points, f"{table}.point")
        _check_range(arrays[f"{table}.keyframe"], n_keyframes, f"{table}.keyframe")
    _check_range(arrays["observations.view"], n_views, "observations.view")
    if len(arrays.get("camera.creep", np.zeros(2))) != 2:
        raise ValueError("camera.creep is not two numbers")
    if np.any(np.diff(arrays["observations.keyframe"]) < 0):
        raise ValueError("observations.keyframe is not in order")
    if np.any(np.abs(arrays["points.offset"]) > _CENTRAL):
        raise ValueError("points.offset lies off the middle of its patch")
    if np.any(np.linalg.det(arrays["points.jacobian"]) == 0.0):
        raise ValueError("points.jacobian cannot be inverted")
    for T in arrays["keyframes.T_world_rig"]:
        se3.assert_proper_rotation(T[:3, :3], "keyframes.T_world_rig")


def _check_rows(name: str, array: Array, points: Points) -> None:
    table, _, column = name.partition(".")
    shape, kind = _ROWS.get(name, (None, ""))
    if table == "points" and hasattr(points, column):
        own = getattr(points, column)
        shape, kind = own.shape[1:], own.dtype.kind
    if shape is None:  # of a later version
        return
    if array.shape[1:] != shape or array.dtype.kind != kind:
        raise ValueError(f"{name} has rows of {array.dtype} {array.shape[1:]}")
    if kind == "f" and name not in _MAY_BE_ABSENT and not np.all(np.isfinite(array)):
        raise ValueError(f"{name} is not finite")


def _check_range(index: Array, count: int, name: str) -> None:
    if len(index) and not 0 <= int(index.min()) <= int(index.max()) < count:
        raise ValueError(f"{name} names a row beyond {count}")
