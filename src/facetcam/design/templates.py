"""Cutting templates: every mirror flat on the bench, seen from the side that reflects, in millimetres."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from facetcam.design.extras import need
from facetcam.design.spec import Making
from facetcam.errors import ConfigError
from facetcam.rig import Mirror, Rig

Array = NDArray[np.float64]

MM = 1000.0
_MARGIN = 12.0  # mm round a template
_TOUCHING = 1e-5  # metres between corners that two mirrors share
_SIDE = "FIRST SURFACE: THIS SIDE"


@dataclass(frozen=True, slots=True)
class Template:
    """One mirror to cut.

    Attributes
    ----------
    name : str
    outline : (N, 2) array
        Corners of the finished mirror in mm, counter-clockwise, as seen from the side that reflects.
    cut : (N, 2) array
        The path of the middle of the cut: half a kerf outside.
    """

    name: str
    outline: Array
    cut: Array

    @property
    def edges(self) -> Array:
        """Lengths (N,) in mm; edge i runs from corner i to the next."""
        lengths: Array = np.linalg.norm(np.roll(self.outline, -1, axis=0) - self.outline, axis=1)
        return lengths

    @property
    def angles(self) -> Array:
        """Inner angles (N,) in degrees."""
        ahead = np.roll(self.outline, -1, axis=0) - self.outline
        back = np.roll(self.outline, 1, axis=0) - self.outline
        cosine = (ahead * back).sum(axis=1) / np.linalg.norm(ahead, axis=1) / np.linalg.norm(back, axis=1)
        degrees: Array = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return degrees

    @property
    def area(self) -> float:
        """Square centimetres."""
        x, y = self.outline.T
        return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 200.0)


def templates(rig: Rig, making: Making) -> list[Template]:
    """One template for each bounded mirror.

    Raises
    ------
    ConfigError
        If the rig has no mirror to cut.
    """
    found = []
    for name, mirror in rig.mirrors.items():
        if mirror.polygon is not None:
            outline = _flat(mirror, reflecting_side(rig, name))
            found.append(Template(name, outline, grown(outline, making.kerf_mm / 2)))
    if not found:
        raise ConfigError("templates: the rig has no bounded mirror to cut")
    return found


def reflecting_side(rig: Rig, name: str) -> Array:
    """Unit normal (3,) of a mirror on the side from which the camera's rays come."""
    mirror = rig.mirrors[name]
    for view in rig.views.values():
        if name in view.mirrors:
            T = rig.T_rig_cam
            for before in view.mirrors[: view.mirrors.index(name)]:
                T = rig.mirrors[before].reflection @ T
            return mirror.normal if mirror.normal @ T[:3, 3] >= mirror.offset else -mirror.normal
    return mirror.normal


def grown(outline: Array, by: float) -> Array:
    """A convex counter-clockwise polygon whose edges have moved outwards by `by`."""
    along = np.roll(outline, -1, axis=0) - outline
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    offset = np.einsum("ij,ij->i", outward, outline) + by
    pairs = np.stack([np.roll(outward, 1, axis=0), outward], axis=1)
    moved: Array = np.linalg.solve(pairs, np.stack([np.roll(offset, 1), offset], axis=1)[..., None])[..., 0]
    return moved


def to_svg(template: Template, title: str) -> str:
    """A drawing true to size: the cut in red, the finished mirror dashed, lengths along its edges."""
    low, high = template.cut.min(axis=0) - _MARGIN, template.cut.max(axis=0) + _MARGIN
    width, height = high - low

    def path(corners: Array) -> str:
        return "M" + "L".join(f"{x - low[0]:.4f},{high[1] - y:.4f}" for x, y in corners) + "Z"

    words = []
    for (x, y), turn, text in _edge_labels(template):
        at = f"{x - low[0]:.2f} {high[1] - y:.2f}"
        place = f'transform="translate({at}) rotate({-turn:.2f})"'
        words.append(f"<text {place}>{text}</text>")
    x, y = template.outline.mean(axis=0)
    for row, text in enumerate((template.name, _SIDE, title)):
        words.append(f'<text x="{x - low[0]:.2f}" y="{high[1] - y + 4.5 * row:.2f}">{escape(text)}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">\n'
        f'<path d="{path(template.cut)}" fill="none" stroke="#ff0000" stroke-width="0.1"/>\n'
        f'<path d="{path(template.outline)}" fill="none" stroke="#808080" stroke-width="0.1" '
        'stroke-dasharray="2 1"/>\n'
        '<g font-family="sans-serif" font-size="3.2" text-anchor="middle" fill="#0000ff">\n'
        + "\n".join(words)
        + "\n</g>\n</svg>\n"
    )


def to_dxf(template: Template, title: str) -> str:
    """The same as DXF R2010 in millimetres, on the layers CUT, MIRROR (finished size) and LABEL."""
    need("ezdxf")
    import ezdxf
    from ezdxf.enums import TextEntityAlignment

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4  # millimetres
    for layer, colour in (("CUT", 1), ("MIRROR", 8), ("LABEL", 5)):
        document.layers.add(layer, color=colour)
    space = document.modelspace()
    for layer, corners in (("CUT", template.cut), ("MIRROR", template.outline)):
        space.add_lwpolyline(corners.tolist(), close=True, dxfattribs={"layer": layer})
    labels = _edge_labels(template)
    x, y = template.outline.mean(axis=0)
    labels += [((x, y - 4.5 * row), 0.0, text) for row, text in enumerate((template.name, _SIDE, title))]
    for place, turn, text in labels:
        words = space.add_text(text, height=2.5, rotation=turn, dxfattribs={"layer": "LABEL"})
        words.set_placement(place, align=TextEntityAlignment.MIDDLE_CENTER)
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def parts_table(rig: Rig, found: list[Template], making: Making) -> list[tuple[str, ...]]:
    """Bill of parts: name, number, what it is; the first row is the head."""
    rows: list[tuple[str, ...]] = [("part", "count", "description")]
    for template in found:
        size = np.ptp(template.outline, axis=0)
        edges = ", ".join(f"{edge:.2f}" for edge in template.edges)
        corners = ", ".join(f"{angle:.2f}" for angle in template.angles)
        what = (
            f"first-surface mirror, {making.thickness_mm:g} mm thick, {size[0]:.1f} x {size[1]:.1f} mm, "
            f"{template.area:.1f} cm2; edges {edges} mm; corners {corners} degrees"
        )
        ground = {name: math.degrees(angle) for name, angle in bevels(rig, template.name).items()}
        if ground and making.thickness_mm > 0:
            what += "; its back ground off at " + ", ".join(f"{d:.1f} (to {n})" for n, d in ground.items())
            what += " degrees from the square edge, so that the glass of neighbours meets"
        rows.append((f"mirror {template.name}", "1", what))
    camera = rig.camera
    rows.append(
        ("camera", "1", f"{camera.width} x {camera.height} pixels, focal length {camera.fx:.0f} pixels")
    )
    return rows


def bevels(rig: Rig, name: str) -> dict[str, float]:
    """Angle in radians by which edges shared with other mirrors are ground off, lest their glass overlaps.

    Half the angle between the faces; none where the faces look at each other, for there the backs part.
    """
    own, normal = rig.mirrors[name].polygon, reflecting_side(rig, name)
    assert own is not None
    found = {}
    for other, mirror in rig.mirrors.items():
        if other == name or mirror.polygon is None:
            continue
        gaps = np.linalg.norm(mirror.polygon[:, None] - own, axis=2).min(axis=1)
        leans_back = float(((mirror.polygon - own[0]) @ normal).min()) < -_TOUCHING
        if (gaps < _TOUCHING).sum() == 2 and leans_back:
            between = float(np.clip(normal @ reflecting_side(rig, other), -1.0, 1.0))
            found[other] = math.acos(between) / 2
    return found


def _flat(mirror: Mirror, normal: Array) -> Array:
    """Corners in the plane of the mirror, counter-clockwise about `normal`; the longest edge lies level."""
    assert mirror.polygon is not None
    corners = mirror.polygon if mirror.normal @ normal > 0 else mirror.polygon[::-1]
    sides = np.roll(corners, -1, axis=0) - corners
    across = sides[np.argmax(np.linalg.norm(sides, axis=1).round(9))]
    across = across / np.linalg.norm(across)
    axes = np.stack([across, np.cross(normal, across)], axis=1)
    flat: Array = MM * (corners - corners.mean(axis=0)) @ axes
    return flat


def _edge_labels(template: Template) -> list[tuple[tuple[float, float], float, str]]:
    """Place, turn in degrees (never upside down) and words of each edge's length, inside the outline."""
    labels = []
    middle = template.outline.mean(axis=0)
    for start, end, length in zip(template.outline, np.roll(template.outline, -1, axis=0), template.edges):
        along = (end - start) / length
        inward = np.array([-along[1], along[0]])
        at = (start + end) / 2 + inward * min(3.0, 0.3 * abs(float((middle - start) @ inward)))
        turn = math.degrees(math.atan2(along[1], along[0]))
        turn = turn - 180.0 if turn > 90.0 else turn + 180.0 if turn <= -90.0 else turn
        labels.append(((float(at[0]), float(at[1])), turn, f"{length:.2f} mm"))
    return labels
