"""Libraries that only making a rig needs, and the line that tells how to get them."""

from __future__ import annotations

from importlib.util import find_spec

from facetcam.errors import FacetcamError


def need(module: str) -> None:
    """Raise FacetcamError, with the command that installs it, unless a library of the extra is there."""
    if find_spec(module) is None:
        raise FacetcamError(f"{module} is not installed: pip install facetcam[design]")
