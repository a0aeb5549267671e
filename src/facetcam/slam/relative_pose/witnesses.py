"""Views as witnesses of a motion: a view counts by what most of its pairs say, not by how many it has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.bool_]

MIN_VIEW_MATCHES = 12  # pairs without which a view is no witness
LEAST_IN_VIEW = 5  # measurements of the map without which it is none


def shares(views: NDArray[np.int8], says: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Views that are witnesses, and the share of their pairs that says something; `says` is (..., N)."""
    witnesses = np.flatnonzero(np.bincount(views) >= MIN_VIEW_MATCHES)
    share = [says[..., views == view].mean(axis=-1) for view in witnesses]
    return witnesses, np.stack(share, axis=-1) if share else np.empty((*says.shape[:-1], 0))


def dissenting(views: NDArray[np.int8], says: NDArray[np.bool_], least: float) -> NDArray[np.int64] | None:
    """Views in which less than a share of the pairs says what most views say; None without a majority."""
    witnesses, share = shares(views, says)
    against = witnesses[share < least]
    return against if not len(against) or 2 * len(against) < len(witnesses) else None
