"""Paper mode against a slow transcription of equations 1-5, and the robust mode against one of its own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from facetcam.features import SIICF


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    """Rectangles at random over a slope of light; some of it clips when eta is added."""
    rng = np.random.default_rng(11)
    image = np.tile(np.linspace(40, 200, 120, dtype=np.float32), (96, 1)).astype(np.uint8)
    for x, y, w, h, grey in rng.integers([0, 0, 8, 8, 5], [110, 90, 30, 30, 250], (40, 5)).tolist():
        cv2.rectangle(image, (x, y), (x + w, y + h), grey, -1)
    return image


def gaussian(image: np.ndarray, sigma: float, radius: int) -> np.ndarray:
    """Equation 3 sampled, normalised and summed pixel by pixel."""
    offsets = np.arange(-radius, radius + 1)
    weights = np.exp(-(offsets[:, None] ** 2 + offsets[None] ** 2) / (2 * sigma**2))
    return ndimage.correlate(image, weights / weights.sum(), mode="mirror")


def central_differences(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    wide = np.pad(image, 1, mode="reflect")
    return (wide[1:-1, 2:] - wide[1:-1, :-2]) / 2, (wide[2:, 1:-1] - wide[:-2, 1:-1]) / 2


def paper_corners(
    D: np.ndarray, etas: tuple[float, ...], sigmas: list[float], threshold: float
) -> set[tuple[int, ...]]:
    """Equations 1-5 and the vote of the intensity changes, as (scale, row, column)."""
    votes: dict[tuple[int, ...], int] = {}
    for eta in etas:
        F = np.clip(D + eta, 0, 255)  # (1)
        f = []
        for sigma in sigmas:
            B = gaussian(F, sigma, int(np.ceil(3 * sigma)))  # (2), (3)
            Lx, Ly = central_differences(B)
            outer = np.array([[Lx * Lx, Lx * Ly], [Lx * Ly, Ly * Ly]])
            sigma_I = sigma / 0.7
            H = [
                [sigma**2 * gaussian(p, sigma_I, int(np.ceil(3 * sigma_I))) for p in row] for row in outer
            ]  # (4)
            f.append(np.linalg.det(np.moveaxis(H, (0, 1), (2, 3))) - 0.04 * (H[0][0] + H[1][1]) ** 2)  # (5)
        peaks = np.array(f) >= ndimage.maximum_filter(np.array(f), 3, mode="nearest") - 1e-9
        for place in zip(*np.nonzero(peaks & (np.array(f) > threshold)), strict=True):
            votes[place] = votes.get(place, 0) + 1
    return {place for place, count in votes.items() if 2 * count > len(etas)}


def test_paper_mode_is_equations_1_to_5(scene: np.ndarray) -> None:
    etas, sigma, k = (-80.0, -40.0, 0.0, 40.0, 80.0), 1.2, 1.4
    expected = paper_corners(scene.astype(float), etas, [sigma, sigma * k, sigma * k * k], 500.0)
    height, width = scene.shape
    inner = {(s, y, x) for s, y, x in expected if 0 < y < height - 1 and 0 < x < width - 1}
    found = SIICF.create(mode="paper", scales=1, sigma=sigma, k=k, etas=etas, max_features=None).detect(scene)
    near = {
        (int(s), *np.rint([y, x]).astype(int).tolist())
        for s, (x, y) in zip(found.level, found.xy, strict=True)
    }
    assert len(inner) > 20
    # Half-way places may round to either pixel: every corner must be found, up to one pixel.
    assert len(found) == len(inner)
    for s, y, x in inner:
        assert any(a == s and abs(b - y) <= 1 and abs(c - x) <= 1 for a, b, c in near)


def test_eta_matters_only_where_it_clips(scene: np.ndarray) -> None:
    middle = (scene // 4 + 100).astype(np.uint8)  # 100 to 163: no eta of 60 clips
    one = SIICF.create(mode="paper", etas=(0.0,), threshold=1.0).detect(middle)
    many = SIICF.create(mode="paper", etas=(-60.0, 0.0, 60.0), threshold=1.0).detect(middle)
    assert len(one) > 50
    np.testing.assert_allclose(many.xy, one.xy, atol=0.05)
    clipped = SIICF.create(mode="paper", etas=(150.0,), threshold=1.0).detect(scene)
    assert len(clipped) < len(SIICF.create(mode="paper", etas=(0.0,), threshold=1.0).detect(scene))


def taps(sigma: float) -> np.ndarray:
    radius = max(1, int(np.floor(2 * sigma + 0.5)))
    weights = np.exp(-(np.arange(-radius, radius + 1.0) ** 2) / (2 * sigma**2))
    whole = np.rint(32 * weights / weights.sum())  # filters are exact in integers of sum 32
    whole[radius] += 32 - whole.sum()
    return whole / 32


def inverse_root(square: np.ndarray, unit: float) -> np.ndarray:
    """1 / sqrt to 3.5 % by halving the exponent of a single (Lomont 2003), of a number in steps of `unit`."""
    bits = np.float32(square / unit**2).view(np.int32)
    return (0x5F375A86 - (bits >> 1)).astype(np.int32).view(np.float32) / unit


def smooth(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    return ndimage.correlate1d(ndimage.correlate1d(image, kernel, 0, mode="mirror"), kernel, 1, mode="mirror")


def robust_response(
    scene: np.ndarray, eta: float, sigma: float, window: float, compression: float
) -> np.ndarray:
    """Response of one scale of the robust mode, in double precision."""
    cumulative = np.cumsum(np.bincount(scene.ravel(), minlength=256)) / scene.size

    def quantile(share: float) -> float:
        bin_ = int(np.argmax(cumulative >= share - 1e-12))
        below = cumulative[bin_ - 1] if bin_ else 0.0
        return bin_ - 0.5 + (share - below) / (cumulative[bin_] - below)

    black, median = quantile(0.01), quantile(0.5)
    scaled = 64 * (scene.astype(float) - black) / (median - black + 1)
    F = 0.5 * (1 + eta / 64) * np.log(np.maximum(scaled, 1 - eta) + eta)
    gx, gy = (sigma * g for g in central_differences(smooth(F, taps(sigma))))
    weight = inverse_root(gx**2 + gy**2 + compression**2, 0.5 * sigma / (16 * 512))
    # Products are mirrored at the border like images.
    h11, h12, h22 = (smooth(weight * p, taps(window)) for p in (gx * gx, gx * gy, gy * gy))
    return np.sqrt(np.maximum(h11 * h22 - h12**2 - 0.01 * (h11 + h22) ** 2, 0))


def test_robust_mode_is_its_transcription(scene: np.ndarray) -> None:
    response = robust_response(scene, 64.0, 1.2, 1.5, 0.05)
    peaks = (response >= ndimage.maximum_filter(response, 5)) & (response > 0.001)
    peaks[:4] = peaks[-4:] = peaks[:, :4] = peaks[:, -4:] = False
    expected = np.column_stack(np.nonzero(peaks))[:, ::-1]
    strength = response[peaks]
    found = SIICF.create(scales=1, max_features=None, threshold=0.02).detect(scene)
    distance = np.abs(found.xy[:, None] - expected).max(axis=2)
    assert len(found) > 40
    # Values are rounded to 1/512, products of gradients to 1/1024.
    assert (distance.min(axis=1) <= 0.55).all()
    nearest = distance.argmin(axis=1)
    assert set(np.flatnonzero(strength > 1.01 * 0.02)) <= set(nearest)
    assert found.response == pytest.approx(strength[nearest], rel=0.01)
