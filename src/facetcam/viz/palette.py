"""Colours of the reports: one for each view, legible on light and on dark ground."""

from __future__ import annotations

VIEW_COLOURS = ("#2f81f7", "#e8890c", "#1aa179", "#c74bd8", "#e5484d", "#12a5bd", "#8a8f0d", "#8b6cf0")


def view_colour(index: int) -> str:
    """Hex colour of view number `index`; more than eight views begin again."""
    return VIEW_COLOURS[index % len(VIEW_COLOURS)]


def view_bgr(index: int) -> tuple[int, int, int]:
    """The same colour as blue, green, red for drawing with OpenCV."""
    red, green, blue = bytes.fromhex(view_colour(index)[1:])
    return blue, green, red
