"""The errors a user meets: one line that says what, where and what to do."""

from __future__ import annotations


class FacetcamError(Exception):
    """Base of every error that facetcam raises on bad input or impossible work."""


class RigError(FacetcamError):
    """A rig file or rig description that cannot be used."""


class ConfigError(FacetcamError):
    """A wrong parameter or configuration key."""


class SourceError(FacetcamError):
    """An image, film, camera or table that cannot be read."""


class OutputError(FacetcamError):
    """A result that cannot be written."""


class MapError(FacetcamError):
    """A map that cannot be used: missing, damaged, foreign, newer, or of another rig."""
