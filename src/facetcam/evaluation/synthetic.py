"""Known changes of any image: geometry, light, sensor. Each returns the changed image and its homography."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from facetcam.evaluation.repeatability import Points
from facetcam.features.images import Image

Change = Callable[[Image], tuple[Image, Points]]

_SEED = 0


def changes() -> dict[str, Change]:
    """All changes by name."""
    return {
        "scale 0.5": lambda image: _warped(image, _about_centre(image, 0.5 * np.eye(2))),
        "scale 0.7": lambda image: _warped(image, _about_centre(image, 0.7 * np.eye(2))),
        "rotation 30": lambda image: _warped(image, _about_centre(image, _rotation(30.0))),
        "rotation 90": lambda image: _warped(image, _about_centre(image, _rotation(90.0))),
        "affine": lambda image: _warped(image, _about_centre(image, np.array([[0.8, 0.25], [0.0, 0.95]]))),
        "gain 1/4": _light(lambda image: 0.25 * image),
        "gain 4": _light(lambda image: 4.0 * image),
        "gamma 0.5": _light(lambda image: 255.0 * (image / 255.0) ** 0.5),
        "gamma 2": _light(lambda image: 255.0 * (image / 255.0) ** 2.0),
        "ramp": _light(lambda image: image * np.linspace(0.2, 1.0, image.shape[1])),
        "half shadow": _light(_half_shadow),
        "lamp": _light(lambda image: image + 120.0 * _spot(image)),
        "clipping": _light(lambda image: image + 80.0),
        "noise": _light(lambda image: image + np.random.default_rng(_SEED).normal(0.0, 4.0, image.shape)),
        "blur": _light(lambda image: cv2.GaussianBlur(image, (0, 0), 1.5)),
        "JPEG": _jpeg,
    }


def _light(change: Callable[[Points], Points]) -> Change:
    """Make a change that leaves every point where it is, rounded and clipped to 8 bits."""

    def changed(image: Image) -> tuple[Image, Points]:
        values = change(image.astype(np.float64))
        return np.clip(np.rint(values), 0, 255).astype(np.uint8), np.eye(3)

    return changed


def _half_shadow(image: Points) -> Points:
    columns = np.arange(image.shape[1])
    return np.asarray(image * np.where(columns < image.shape[1] // 2, 0.2, 1.0))


def _jpeg(image: Image) -> tuple[Image, Points]:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 20])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)), np.eye(3)


def _warped(image: Image, H: Points) -> tuple[Image, Points]:
    height, width = image.shape
    return np.asarray(
        cv2.warpPerspective(image, H, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT)
    ), H


def _about_centre(image: Image, A: Points) -> Points:
    """Homography of a linear map about the image's centre."""
    centre = (np.array(image.shape[::-1]) - 1) / 2
    H = np.eye(3)
    H[:2, :2], H[:2, 2] = A, centre - A @ centre
    return H


def _rotation(degrees: float) -> Points:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def _spot(image: Points) -> Points:
    """Light of a lamp over the upper right quarter, falling off as a Gaussian."""
    height, width = image.shape
    v, u = np.mgrid[0:height, 0:width]
    return np.asarray(
        np.exp(-((u - 0.75 * width) ** 2 + (v - 0.25 * height) ** 2) / (2 * (0.2 * width) ** 2))
    )
