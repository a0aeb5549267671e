"""Pictures in space: framed so that nothing is cut off and little is left empty."""

import numpy as np
import pytest

from facetcam.viz.space import empty_space, frame_axes


@pytest.mark.parametrize("sides", [(400, 300, 60), (40, 40, 300), (10, 10, 10)])
@pytest.mark.parametrize("box", [None, (1.0, 0.5, 5.0, 3.0)])
def test_frames_what_it_shows(sides, box):
    points = np.random.default_rng(1).uniform(-1, 1, (60, 3)) * sides + (5.0, -300.0, 80.0)
    figure, axes = empty_space(7.2, 5.6)
    frame_axes(axes, points, box)
    places = drawn_inches(figure, axes, points)
    left, bottom, width, height = box or (0.0, 0.0, *figure.get_size_inches())
    gaps = np.array([
        places.min(axis=0) - (left, bottom), np.array([left + width, bottom + height]) - places.max(axis=0)
    ])  # fmt: skip
    assert gaps.min() > 0.25
    assert gaps.sum(axis=0).min() < 0.7  # the picture fills its width or its height
    if box is None:
        assert gaps[:, 1].max() < 0.35 and height <= 5.6 + 1e-9


def drawn_inches(figure, axes, points):
    """Where matplotlib itself draws the points (N, 3), in inches from the lower left."""
    (dots,) = axes.plot(*points.T, "o")
    figure.draw_without_rendering()
    return axes.transData.transform(dots.get_xydata()) / figure.dpi
