"""Reading and writing `rig.yaml`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from facetcam.errors import RigError
from facetcam.rig.camera import Camera
from facetcam.rig.mirrors import Mirror
from facetcam.rig.rig import Rig, View

_CAMERA_KEYS = ("model", "width", "height", "fx", "fy", "cx", "cy", "distortion", "T_rig_cam")


def read_rig(path: Path) -> Rig:
    """Read and check a rig file.

    Raises
    ------
    RigError
        If the file is missing, is not YAML, has an unknown or missing key, or describes an impossible rig.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RigError(f"{path}: cannot be read ({error.strerror}); give the path of a rig.yaml") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise RigError(f"{path}: not a YAML file ({' '.join(str(error).split())})") from None
    try:
        return _rig(document)
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def write_rig(rig: Rig, path: Path) -> None:
    """Write a rig file; an existing file is not replaced."""
    text = yaml.safe_dump(_document(rig), sort_keys=False, default_flow_style=None, width=120)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise RigError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise RigError(f"{path}: cannot be written ({error.strerror})") from None


def _rig(document: Any) -> Rig:
    top = _mapping(document, "rig", ("camera", "mirrors", "views"), ("camera", "views"))
    camera = _mapping(top["camera"], "camera", _CAMERA_KEYS, _CAMERA_KEYS)
    mirrors = {str(k): _mirror(str(k), v) for k, v in _items(top.get("mirrors") or {}, "mirrors")}
    views = {str(k): _view(str(k), v) for k, v in _items(top["views"], "views")}
    T_rig_cam = _numbers(camera["T_rig_cam"], "camera: T_rig_cam", (4, 4))
    if not np.allclose(T_rig_cam[3], (0, 0, 0, 1)):
        raise RigError("camera: the last row of T_rig_cam must be [0, 0, 0, 1]")
    intrinsics = {k: camera[k] for k in ("fx", "fy", "cx", "cy")}
    numbers = {k: float(_numbers(v, f"camera: {k}", ())) for k, v in intrinsics.items()}
    width, height = (int(_numbers(camera[k], f"camera: {k}", ())) for k in ("width", "height"))
    distortion = tuple(float(c) for c in _numbers(camera["distortion"], "camera: distortion", (None,)))
    return Rig(
        Camera(str(camera["model"]), width, height, **numbers, distortion=distortion),
        T_rig_cam,
        mirrors,
        views,
    )


def _mirror(name: str, node: Any) -> Mirror:
    where = f"mirror '{name}'"
    mirror = _mapping(node, where, ("polygon", "plane"), ())
    if len(mirror) != 1:
        raise RigError(f"{where}: give either a polygon or a plane")
    if "polygon" in mirror:
        return Mirror.from_polygon(name, _numbers(mirror["polygon"], f"{where}: polygon", (None, 3)))
    plane = _mapping(mirror["plane"], f"{where}: plane", ("normal", "offset"), ("normal", "offset"))
    normal = _numbers(plane["normal"], f"{where}: normal", (3,))
    return Mirror.from_plane(name, normal, float(_numbers(plane["offset"], f"{where}: offset", ())))


def _view(name: str, node: Any) -> View:
    where = f"view '{name}'"
    view = _mapping(node, where, ("mirrors", "region"), ("mirrors",))
    mirrors = view["mirrors"]
    if not isinstance(mirrors, list) or not all(isinstance(m, str) for m in mirrors):
        raise RigError(f"{where}: mirrors takes a list of mirror names, [] for the direct view")
    region = None if view.get("region") is None else _numbers(view["region"], f"{where}: region", (None, 2))
    if region is not None and len(region) < 3:
        raise RigError(f"{where}: region takes three or more pixels [u, v]")
    return View(tuple(mirrors), region)


def _mapping(node: Any, where: str, allowed: Iterable[str], required: Iterable[str]) -> dict[str, Any]:
    """Return a mapping whose keys are all known and complete."""
    if not isinstance(node, Mapping):
        raise RigError(f"{where}: expected keys {', '.join(allowed)}, got {type(node).__name__}")
    for key in node:
        if key not in allowed:
            near = difflib.get_close_matches(str(key), list(allowed), 1)
            hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(allowed)}"
            raise RigError(f"{where}: unknown key '{key}'; {hint}")
    missing = [key for key in required if key not in node]
    if missing:
        raise RigError(f"{where}: missing {', '.join(missing)}")
    return dict(node)


def _items(node: Any, where: str) -> Iterable[tuple[Any, Any]]:
    if not isinstance(node, Mapping):
        raise RigError(f"{where}: expected names with their description, got {type(node).__name__}")
    return node.items()


def _numbers(node: Any, where: str, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return finite numbers of a shape in which None stands for any length."""
    try:
        array = np.asarray(node, dtype=np.float64)
    except (TypeError, ValueError):
        raise RigError(f"{where}: expected numbers, got {node!r:.60}") from None
    fits = array.ndim == len(shape) and all(w is None or w == n for w, n in zip(shape, array.shape))
    if not fits or node is None:
        wanted = "x".join("N" if n is None else str(n) for n in shape) or "one number"
        raise RigError(f"{where}: expected {wanted}, got shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise RigError(f"{where}: a number is not finite")
    return array


def _document(rig: Rig) -> dict[str, Any]:
    camera = rig.camera
    intrinsics = {k: getattr(camera, k) for k in _CAMERA_KEYS[:7]}
    return {
        "camera": {**intrinsics, "distortion": list(camera.distortion), "T_rig_cam": rig.T_rig_cam.tolist()},
        "mirrors": {
            name: {"plane": {"normal": m.normal.tolist(), "offset": m.offset}}
            if m.polygon is None
            else {"polygon": m.polygon.tolist()}
            for name, m in rig.mirrors.items()
        },
        "views": {
            name: {"mirrors": list(v.mirrors)} | ({} if v.region is None else {"region": v.region.tolist()})
            for name, v in rig.views.items()
        },
    }
