"""Views of one grey all over: what the map expects there is no evidence against a pose."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from slam_worlds import folded, pyramid

from facetcam.rig import Rig
from facetcam.slam.camera.blank import blank_views
from facetcam.slam.camera.frame import make_frame
from facetcam.slam.camera.optics import Optics

RIGS = {"folded": folded(), "pyramid": pyramid()}
OPTICS = {name: Optics(rig, 8.0) for name, rig in RIGS.items()}


def blank(rig: str, image: NDArray[np.floating]) -> list[bool]:
    grey = np.clip(image, 0, 255).astype(np.uint8)
    found = blank_views(make_frame(grey, 0.0, RIGS[rig].size), OPTICS[rig])
    return [bool(b) for b in found]


def in_view(rig: Rig, view: int) -> NDArray[np.bool_]:
    return np.asarray(rig.labels() == view)


def bars(rig: Rig) -> NDArray[np.float64]:
    """Furniture, in every view."""
    rows, columns = np.indices(rig.labels().shape)
    return 100.0 + 60.0 * np.sign(np.sin(columns / 9.0) * np.sin(rows / 7.0))


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("filled", [0.0, 90.0, 255.0])
def test_views_without_a_picture_are_blank_and_no_others(rig: str, filled: float) -> None:
    for view in range(OPTICS[rig].n_views):
        image = np.where(in_view(RIGS[rig], view), filled, bars(RIGS[rig]))
        assert blank(rig, image) == [v == view for v in range(OPTICS[rig].n_views)]


@pytest.mark.parametrize("rig", RIGS)
def test_noise_is_no_picture(rig: str) -> None:
    """A finger on a mirror: dim, and grainy."""
    noise = np.random.default_rng(5).integers(0, 12, RIGS[rig].labels().shape).astype(float)
    assert blank(rig, np.where(in_view(RIGS[rig], 1), noise, bars(RIGS[rig])))[1]


@pytest.mark.parametrize("rig", RIGS)
def test_a_plain_wall_is_no_blank_view(rig: str) -> None:
    """Light falls on it from one side: that nothing of the map is there tells something."""
    _, columns = np.indices(RIGS[rig].labels().shape)
    wall = 180.0 + 0.03 * columns
    assert not any(blank(rig, np.where(in_view(RIGS[rig], 1), wall, bars(RIGS[rig]))))


@pytest.mark.parametrize("rig", RIGS)
def test_in_the_dark_no_view_is_blank(rig: str) -> None:
    """The map is still there: a pose that nothing bears out is none."""
    assert not any(blank(rig, np.zeros(RIGS[rig].labels().shape)))
