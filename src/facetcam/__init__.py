"""Room-wide vision from one camera and a few flat mirrors."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from facetcam.errors import FacetcamError
    from facetcam.features import SIICF
    from facetcam.pipelines.calibrate_in_memory import calibrate
    from facetcam.rig import Rig
    from facetcam.slam import Slam
    from facetcam.unwrapping import unwrap

__version__ = "0.1.0"

__all__ = ["SIICF", "FacetcamError", "Rig", "Slam", "calibrate", "unwrap"]

_HOMES = {
    "FacetcamError": "errors",
    "Rig": "rig",
    "SIICF": "features",
    "Slam": "slam",
    "calibrate": "pipelines.calibrate_in_memory",
    "unwrap": "unwrapping",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, so that `facetcam --help` answers at once."""
    if name not in _HOMES:
        raise AttributeError(f"module 'facetcam' has no attribute '{name}'")
    return getattr(import_module(f"facetcam.{_HOMES[name]}"), name)
