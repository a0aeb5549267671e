"""The design page in the browser, and the rigs that are saved from it."""

from __future__ import annotations

from pathlib import Path

from facetcam.design.family import make_rig
from facetcam.design.spec import DesignSpec, read_spec
from facetcam.io.outputs import atomic_write, writing
from facetcam.pipelines.design import design_yaml
from facetcam.viz.design_live import LivePage


def open_live_page(source: Path | str, out: Path | str, port: int = 8080) -> LivePage:
    """Open the page of a design; its button writes `rig-N.yaml` and `design-N.yaml` into `out`.

    Raises
    ------
    FacetcamError
        If the design cannot be, has no parameters, or viser is not installed.
    """
    spec = read_spec(source)
    if spec.family is not None:
        make_rig(spec)
    folder = Path(out)
    return LivePage(spec, lambda shown: save_design(shown, folder), port)


def save_design(spec: DesignSpec, folder: Path) -> str:
    """Write a design and its rig under the next free number; returns what to tell."""
    rig = make_rig(spec)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    number = 1
    while (folder / f"rig-{number}.yaml").exists() or (folder / f"design-{number}.yaml").exists():
        number += 1
    rig.save(folder / f"rig-{number}.yaml")
    atomic_write(folder / f"design-{number}.yaml", design_yaml(spec))
    return f"saved `{folder / f'rig-{number}.yaml'}` and `design-{number}.yaml`"
