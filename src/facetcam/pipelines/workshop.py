"""The files that make a rig: templates, a bill of parts, a holder."""

from __future__ import annotations

import csv
import io

from facetcam.design.holder import holder, to_stl
from facetcam.design.spec import DesignSpec
from facetcam.design.templates import parts_table, templates, to_dxf, to_svg
from facetcam.rig import Rig


def workshop_files(rig: Rig, spec: DesignSpec) -> dict[str, bytes]:
    """All files by name; a holder only for the rigs of the family.

    Raises
    ------
    FacetcamError
        If there is nothing to cut or to print, or a library of the extra is missing.
    """
    found = templates(rig, spec.making)
    title = spec.title or "facetcam"
    files = {}
    for template in found:
        files[f"{template.name}.svg"] = to_svg(template, title).encode()
        files[f"{template.name}.dxf"] = to_dxf(template, title).encode()
    parts = parts_table(rig, found, spec.making)
    if spec.family is not None:
        for name, solid in holder(rig, spec.family, spec.body, spec.making).items():
            files[f"{name}.stl"] = to_stl(solid)
            parts.append((name, "1", f"printed, {solid.volume() / 1000:.0f} cm3"))
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows(parts)
    files["parts.csv"] = table.getvalue().encode()
    return files
