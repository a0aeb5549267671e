"""Intrinsics measured elsewhere: OpenCV and ROS camera files, Kalibr camchains."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from facetcam.config import yaml_problem
from facetcam.errors import FacetcamError, SourceError
from facetcam.rig.camera import BROWN_CONRADY, COEFFICIENTS, KANNALA_BRANDT, Camera

_FISHEYE = ("equidistant", "fisheye", "kannala-brandt", "kannala_brandt")
_PLAIN = ("radtan", "plumb_bob", "radial-tangential", "brown-conrady", "none", "")


def read_intrinsics(path: Path | str) -> Camera:
    """Read a camera of a file by OpenCV, ROS (`camera_info`) or Kalibr (`camchain.yaml`, its first camera).

    Raises
    ------
    SourceError
        If the file cannot be read, is of none of these kinds, or has another lens model.
    """
    where = Path(path)
    document = _read(where)
    try:
        if "cam0" in document:
            return _kalibr(document["cam0"])
        if "camera_matrix" in document:
            return _opencv(document)
    except (FacetcamError, KeyError, TypeError, ValueError, IndexError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise SourceError(f"{where}: not usable as intrinsics ({reason})") from error
    raise SourceError(f"{where}: neither an OpenCV camera (camera_matrix) nor a Kalibr camchain (cam0)")


def _read(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise SourceError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SourceError(f"{path}: not a text file") from error
    # OpenCV writes '%YAML:1.0', which YAML forbids, and tags its matrices.
    text = re.sub(r"\A%YAML[^\n]*\n", "", text).replace("!!opencv-matrix", "")
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise SourceError(f"{path}: not a usable YAML file ({yaml_problem(error)})") from error
    if not isinstance(document, dict):
        raise SourceError(f"{path}: not a camera file")
    return document


def _kalibr(camera: Mapping[str, Any]) -> Camera:
    model = camera.get("camera_model", "pinhole")
    if model != "pinhole":
        raise ValueError(f"camera model '{model}', use pinhole")
    width, height = camera["resolution"]
    fx, fy, cx, cy = camera["intrinsics"]
    return _camera((width, height), (fx, fy, cx, cy), camera["distortion_coeffs"], camera["distortion_model"])


def _opencv(document: Mapping[str, Any]) -> Camera:
    K = _matrix(document["camera_matrix"]).reshape(3, 3)
    if abs(K[0, 1]) > 1e-9 * abs(K[0, 0]):
        raise ValueError("a skewed camera matrix")
    key = "distortion_coefficients" if "distortion_coefficients" in document else "dist_coeffs"
    kind = str(document.get("distortion_model", ""))
    if document.get("fisheye_model") or document.get("fisheye"):
        kind = "fisheye"
    size = document["image_width"], document["image_height"]
    return _camera(size, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), _matrix(document[key]).ravel(), kind)


def _matrix(node: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array(node["data"] if isinstance(node, dict) else node, dtype=np.float64)


def _camera(size: tuple[Any, Any], pinhole: tuple[Any, ...], coefficients: Any, kind: str) -> Camera:
    numbers = [float(number) for number in coefficients]
    if kind.lower() in _FISHEYE:
        model = KANNALA_BRANDT
    elif kind.lower() in _PLAIN:
        model = BROWN_CONRADY
    else:
        raise ValueError(f"distortion model '{kind}', use radtan or equidistant")
    wanted = COEFFICIENTS[model]
    if any(number != 0.0 for number in numbers[wanted:]):
        raise ValueError(f"{len(numbers)} distortion numbers, {model} has {wanted}")
    numbers = (numbers + [0.0] * wanted)[:wanted]
    fx, fy, cx, cy = (float(number) for number in pinhole)
    return Camera(model, int(size[0]), int(size[1]), fx, fy, cx, cy, tuple(numbers))
