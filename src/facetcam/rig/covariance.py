"""How well a rig is known: the covariance that its calibration gave."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.config import from_mapping, nearest
from facetcam.errors import RigError

Array = NDArray[np.float64]

LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
MOTIONS = ("tilt u", "tilt v", "shift")
GLASS = ("thickness", "index")
_ASYMMETRY = 1e-6  # of a written covariance, of its largest entry, that rounding explains


@dataclass(frozen=True)
class Axes:
    """How a mirror moves: its normal tilts towards `u` and `v` about `pivot`, and it shifts along its normal.

    Rig frame; `u` and `v` have unit length, `pivot` is in metres.
    """

    u: tuple[float, float, float]
    v: tuple[float, float, float]
    pivot: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class RigCovariance:
    """Covariance of a rig's numbers.

    Parameters
    ----------
    parameters : tuple of str
        `fx`, `k1`, ..., `MIRROR: tilt u`, `MIRROR: tilt v`, `MIRROR: shift` (see `Axes`), or of the glass
        before it `MIRROR: thickness`, `MIRROR: index`.
    matrix : (P, P) array
        Pixels, radians and metres. Numbers that are not listed were held.
    axes : mapping of mirror to Axes

    Raises
    ------
    RigError
        If the parts do not fit each other or the matrix is not a covariance.
    """

    parameters: tuple[str, ...]
    matrix: Array
    axes: Mapping[str, Axes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.parameters)
        if len(set(self.parameters)) != count:
            raise RigError("covariance: a parameter is listed twice")
        if self.matrix.shape != (count, count) or not np.all(np.isfinite(self.matrix)):
            raise RigError(f"covariance: {count} parameters take a matrix of {count}x{count} finite numbers")
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        if np.any(np.diag(self.matrix) <= 0.0):
            raise RigError("covariance: the variances on the diagonal must be above zero")
        correlation = self.matrix / np.outer(scale, scale)
        if np.abs(correlation - correlation.T).max(initial=0.0) > _ASYMMETRY:
            raise RigError("covariance: the matrix must be symmetric")
        if count and np.linalg.eigvalsh(correlation).min() < -_ASYMMETRY * count:
            raise RigError("covariance: the matrix has a negative variance in some direction")

    def check(self, mirrors: Iterable[str]) -> None:
        """Raise RigError if a parameter is none of a rig with these mirrors."""
        mirrors = list(mirrors)
        for name in self.parameters:
            mirror, _, motion = name.partition(": ")
            if motion in GLASS and mirror not in mirrors:
                raise RigError(f"covariance: '{name}' is of a mirror that the rig does not have")
            if motion and motion not in GLASS and mirror not in self.axes:
                raise RigError(f"covariance: '{name}' needs the axes of mirror '{mirror}'")
            known = (*MOTIONS, *GLASS) if motion else LENS
            if (motion or mirror) not in known:
                raise RigError(f"covariance: unknown parameter '{name}'; {nearest(motion or mirror, known)}")
        for mirror in self.axes:
            if mirror not in mirrors:
                hint = nearest(mirror, mirrors) if mirrors else "the rig has none"
                raise RigError(f"covariance: no mirror '{mirror}' in the rig; {hint}")


@dataclass(frozen=True)
class _Entry:
    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    axes: Mapping[str, Any] = field(default_factory=dict)


def from_node(node: object) -> RigCovariance | None:
    """The covariance of a rig file, if it has one.

    Raises
    ------
    RigError, ConfigError
        If it does not fit.
    """
    if node is None:
        return None
    content = dict(node) if isinstance(node, Mapping) else node
    axes = content.pop("axes", None) or {} if isinstance(content, dict) else {}
    if not isinstance(axes, Mapping):
        raise RigError("covariance: axes takes mirrors with u, v and pivot")
    entry = from_mapping(_Entry, content, "covariance")
    if len({len(row) for row in entry.matrix}) > 1:
        raise RigError("covariance: the rows of the matrix have different lengths")
    matrix = np.array(entry.matrix, dtype=np.float64).reshape(len(entry.matrix), -1)
    named = {str(m): from_mapping(Axes, a, f"covariance: axes: {m}") for m, a in axes.items()}
    return RigCovariance(entry.parameters, matrix, named)


def to_node(covariance: RigCovariance) -> dict[str, Any]:
    """The content of the file's `covariance`."""
    axes = {
        m: {key: list(getattr(a, key)) for key in ("u", "v", "pivot")} for m, a in covariance.axes.items()
    }
    return {
        "parameters": list(covariance.parameters),
        "matrix": covariance.matrix.tolist(),
        **({"axes": axes} if axes else {}),
    }
