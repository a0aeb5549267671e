"""What a run says of a scale that rests on a rig's drawing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from facetcam.pipelines.summary import Summary


@pytest.mark.parametrize(
    ("metric", "sigma", "said"),
    [(True, 0.42, "± 42 %"), (True, np.inf, "unknown"), (True, None, ""), (False, 0.42, "")],
)
def test_the_scale_of_a_drawing(metric: bool, sigma: float | None, said: str) -> None:
    """A rig that leaves nothing of the scale must not look like one that was calibrated."""
    summary = SimpleNamespace(metric=metric, drawn_scale_sigma=sigma)
    rows = Summary.if_drawn.fget(cast(Summary, summary))  # type: ignore[attr-defined]
    assert [value.split(":")[0] for value in rows.values()] == ([said] if said else [])
