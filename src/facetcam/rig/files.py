"""Reading and writing `rig.yaml`."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray

from facetcam.config import from_mapping, nearest, read_yaml
from facetcam.errors import ConfigError, RigError
from facetcam.rig import covariance
from facetcam.rig.camera import Camera
from facetcam.rig.mirrors import Glass, Mirror
from facetcam.rig.rig import Rig
from facetcam.rig.view import View

Built = TypeVar("Built")

Array = NDArray[np.float64]
Row4 = tuple[float, float, float, float]

_KEYS = ("camera", "mirrors", "views", "covariance", "solved_from")
_EXACT = 1e-9  # largest deviation of R R' from the identity in a file written with all digits
_LARGEST = 1e9  # of any number in a rig file
_ROUNDED = 1e-4  # and in one written with four


@dataclass(frozen=True)
class _CameraEntry:
    model: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    T_rig_cam: tuple[Row4, Row4, Row4, Row4]


@dataclass(frozen=True)
class _PlaneEntry:
    normal: tuple[float, float, float]
    offset: float


@dataclass(frozen=True)
class _MirrorEntry:
    polygon: tuple[tuple[float, float, float], ...] | None = None
    plane: _PlaneEntry | None = None
    glass: Glass | None = None


@dataclass(frozen=True)
class _ViewEntry:
    mirrors: tuple[str, ...]
    region: tuple[tuple[float, float], ...] | None = None


def read_rig(path: Path) -> Rig:
    """Read and check a rig file.

    Raises
    ------
    RigError
        If the file is missing, is not YAML, has an unknown or missing key or a wrong value, or describes a
        rig that cannot be: see `Rig` and `Rig.check`.
    """
    try:
        rig = from_document(read_yaml(path))
        rig.check()
    except ConfigError as error:
        raise RigError(str(error) if str(error).startswith(f"{path}:") else f"{path}: {error}") from error
    except RigError as error:
        raise RigError(f"{path}: {error}") from error
    return rig


def write_rig(rig: Rig, path: Path) -> None:
    """Write a rig file; an existing file is not replaced."""
    text = yaml.safe_dump(document(rig), sort_keys=False, default_flow_style=None, width=120)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RigError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise RigError(f"{path}: cannot be written ({error.strerror})") from error


def digest(rig: Rig) -> str:
    """SHA-256 of everything that a rig file says, as hexadecimal."""
    return hashlib.sha256(json.dumps(document(rig)).encode()).hexdigest()


def from_document(node: object) -> Rig:
    """Make a rig from the content of its file; raises RigError or ConfigError if it does not fit."""
    sections = _named(node, "rig", lambda name, node: node)
    if not sections.keys().isdisjoint(("family", "rig")):
        raise RigError("a drawing, not a rig; run facetcam design on it, and give the rig.yaml it writes")
    for key, content in sections.items():
        _check_range(content, key)
        if key not in _KEYS:
            raise RigError(f"unknown key {key!r}; {nearest(key, _KEYS)}")
    for key in ("camera", "views"):
        if key not in sections:
            raise RigError(f"missing key {key!r}")
    camera = from_mapping(_CameraEntry, sections["camera"], "camera")
    intrinsics = {key: value for key, value in vars(camera).items() if key != "T_rig_cam"}
    return Rig(
        Camera(**intrinsics),
        _without_rounding(np.array(camera.T_rig_cam)),
        _named(sections.get("mirrors") or {}, "mirrors", _mirror),
        _named(sections["views"], "views", _view),
        covariance.from_node(sections.get("covariance")),
        _solved_from(sections.get("solved_from")),
    )


def _solved_from(node: object) -> str | None:
    if node is not None and not (isinstance(node, str) and re.fullmatch(r"[0-9a-f]{8,128}", node)):
        raise RigError("solved_from: takes the digest that a calibration wrote, hexadecimal")
    return node


def _without_rounding(T: Array) -> Array:
    """Turn a rotation that was written with few digits into the nearest exact one."""
    R = T[:3, :3]
    error = np.abs(R @ R.T - np.eye(3)).max()
    if _EXACT < error < _ROUNDED:
        U, _, Vt = np.linalg.svd(R)
        T[:3, :3] = U @ Vt
    return T


def _check_range(node: object, where: str) -> None:
    """Refuse numbers whose squares and products would leave floating point, whatever they stand for."""
    if isinstance(node, (int, float)) and abs(node) > _LARGEST:
        raise RigError(f"{where}: a number beyond {_LARGEST:g}; give metres and pixels")
    if isinstance(node, dict):
        for key, value in node.items():
            _check_range(value, f"{where}: {key}")
    if isinstance(node, list):
        for value in node:
            _check_range(value, where)


def _named(node: object, where: str, build: Callable[[str, Any], Built]) -> dict[str, Built]:
    if not isinstance(node, dict):
        raise RigError(f"{where}: expected names with their content, got {type(node).__name__}")
    return {str(name): build(str(name), content) for name, content in node.items()}


def _mirror(name: str, node: object) -> Mirror:
    try:
        entry = from_mapping(_MirrorEntry, node, f"mirror '{name}'")
    except RigError as error:
        raise RigError(f"mirror '{name}': {error}") from None
    if entry.polygon is not None and entry.plane is None:
        return replace(Mirror.from_polygon(name, entry.polygon), glass=entry.glass)
    if entry.plane is not None and entry.polygon is None:
        return replace(Mirror.from_plane(name, entry.plane.normal, entry.plane.offset), glass=entry.glass)
    raise RigError(f"mirror '{name}': give either a polygon or a plane")


def _view(name: str, node: object) -> View:
    entry = from_mapping(_ViewEntry, node, f"view '{name}'")
    return View(entry.mirrors, None if entry.region is None else np.array(entry.region))


def document(rig: Rig) -> dict[str, Any]:
    """All that the rig's file says, as plain lists, names and numbers."""
    known = {} if rig.covariance is None else {"covariance": covariance.to_node(rig.covariance)}
    return _geometry(rig) | known | ({} if rig.solved_from is None else {"solved_from": rig.solved_from})


def _geometry(rig: Rig) -> dict[str, Any]:
    camera = rig.camera
    return {
        "camera": {
            "model": camera.model,
            **{key: int(getattr(camera, key)) for key in ("width", "height")},
            **{key: float(getattr(camera, key)) for key in ("fx", "fy", "cx", "cy")},
            "distortion": [float(number) for number in camera.distortion],
            "T_rig_cam": rig.T_rig_cam.tolist(),
        },
        "mirrors": {name: _mirror_document(mirror) for name, mirror in rig.mirrors.items()},
        "views": {
            name: {"mirrors": list(v.mirrors)} | ({} if v.region is None else {"region": v.region.tolist()})
            for name, v in rig.views.items()
        },
    }


def _mirror_document(mirror: Mirror) -> dict[str, Any]:
    glass = {} if mirror.glass is None else asdict(mirror.glass)
    behind = {"glass": {key: number for key, number in glass.items() if number is not None}} if glass else {}
    if mirror.polygon is None:
        return {"plane": {"normal": mirror.normal.tolist(), "offset": mirror.offset}} | behind
    return {"polygon": mirror.polygon.tolist()} | behind
