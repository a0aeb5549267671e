"""A page in the browser on which a rig follows the sliders: mirrors, rays, sensor image and coverage."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from facetcam.design.areas import Area, view_areas
from facetcam.design.cones import solid_angle
from facetcam.design.extras import need
from facetcam.design.family import build, check_built
from facetcam.design.spec import DesignSpec, Family
from facetcam.errors import ConfigError, FacetcamError
from facetcam.rig import Rig
from facetcam.viz.design_live_pictures import WIDTH, blank, rgb, sensor_picture, sphere_picture, summary
from facetcam.viz.palette import view_colour
from facetcam.viz.rig_figures import ray_path

if TYPE_CHECKING:
    from viser import ViserServer

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

SLIDERS: dict[str, tuple[str, float, float, float, float]] = {
    "radius": ("radius (mm)", 20.0, 150.0, 0.5, 1000.0),
    "tilt_degrees": ("tilt (degrees)", 5.0, 75.0, 0.1, 1.0),
    "height": ("height (mm)", 20.0, 400.0, 0.5, 1000.0),
    "depth": ("depth of facets (mm)", 3.0, 149.0, 0.5, 1000.0),
    "aspect": ("aspect", 1.0, 2.0, 0.01, 1.0),
    "camera_height": ("camera above base (mm)", 5.0, 300.0, 0.5, 1000.0),
}
"""Words, least, most, step and unit of each parameter that has a slider."""

FEWEST, MOST = 3, 12  # faces
_SIZE = 10.0  # units of the 3D scene a metre, where its first view looks right
_RAYS = 4  # near the corners of a view


class LivePage:
    """The page of one design; it changes as its sliders move, and shows the last rig that can be built.

    Parameters
    ----------
    spec : DesignSpec
        Where it begins; a design of the family.
    save : callable
        Called with the design shown when its button is pressed; returns words for the page.
    port : int
        Of the local web server; the next free one is taken if it is busy.

    Raises
    ------
    FacetcamError
        If the design has no parameters, or viser is not installed.
    """

    def __init__(self, spec: DesignSpec, save: Callable[[DesignSpec], str], port: int = 8080) -> None:
        if spec.family is None:
            raise ConfigError("live: a rig of its own has no parameters to change; give a family")
        need("viser")
        import viser

        self.spec, self.redraws, self.seconds = spec, 0, 0.0
        self._save, self._changed, self._stopped = save, threading.Event(), threading.Event()
        self.server: ViserServer = viser.ViserServer(
            "127.0.0.1", port, label="facetcam design", verbose=False
        )
        self._add_controls(spec.family)
        self._drawn: set[str] = set()
        family = spec.family
        reach = _SIZE * max(2.0 * family.radius * family.aspect, family.height)
        self.server.initial_camera.position = (0.9 * reach, 1.5 * reach, 1.3 * reach)
        self.server.initial_camera.look_at = (0.0, 0.0, 0.45 * _SIZE * family.height)
        self.redraw()
        self._worker = threading.Thread(target=self._follow, daemon=True)
        self._worker.start()

    @property
    def address(self) -> str:
        """Where the browser finds it."""
        return f"http://127.0.0.1:{self.server.get_port()}"

    def stop(self) -> None:
        """Close the page."""
        self.stop_following()
        self.server.stop()

    def stop_following(self) -> None:
        """Leave the page as it is, whatever its sliders do; `redraw` still shows them."""
        self._stopped.set()
        self._changed.set()
        self._worker.join(5.0)

    def redraw(self) -> None:
        """Show the rig of the sliders, or say in one line why there is none."""
        begin = time.perf_counter()
        spec = self._wished()
        try:
            assert spec.family is not None
            rig = build(spec.family, spec.camera)
            check_built(rig, spec.family, spec.body)
            areas = view_areas(rig, spec.body)
            if min(area.solid_angle for area in areas.values()) < 1e-6:
                raise ConfigError("a view sees nothing of the room")
        except FacetcamError as error:
            self._words.content = f"**Cannot be built:** {error}"
        else:
            self.spec = spec
            self._draw_scene(rig, areas)
            self._sensor.image = sensor_picture(rig, areas)
            self._sphere.image = sphere_picture(areas)
            self._words.content = summary(rig, areas)
        self.seconds = time.perf_counter() - begin
        self.redraws += 1

    def _follow(self) -> None:
        """Redraw whenever something changed; what changed meanwhile is drawn once, as it is then."""
        while True:
            self._changed.wait()
            self._changed.clear()
            if self._stopped.is_set():
                return
            self.redraw()

    def _wished(self) -> DesignSpec:
        family = self.spec.family
        assert family is not None
        values: dict[str, Any] = {name: s.value / SLIDERS[name][4] for name, s in self.sliders.items()}
        if family.depth is None and not self._touched_depth:
            values["depth"] = None
        camera = replace(self.spec.camera, focal=None if self._fit.value else float(self.focal.value))
        return replace(
            self.spec, family=replace(family, faces=int(self.faces.value), **values), camera=camera
        )

    def _add_controls(self, family: Family) -> None:
        gui = self.server.gui
        self._words = gui.add_markdown("")
        self.faces: Any = gui.add_slider("faces", FEWEST, MOST, 1, min(max(family.faces, FEWEST), MOST))
        self.sliders: dict[str, Any] = {}
        for name, (words, low, high, step, unit) in SLIDERS.items():
            value = getattr(family, name)
            if name == "camera_height" and not family.fold:
                continue
            start = unit * (family.radius if value is None else value)
            low, high = min(low, start), max(high, start)
            self.sliders[name] = gui.add_slider(words, low, high, step, start)
            self.sliders[name].on_update(lambda _: self._changed.set())
        self._touched_depth = family.depth is not None
        self.sliders["depth"].on_update(self._touch_depth)
        focal = self.spec.camera.focal
        self._fit: Any = gui.add_checkbox("longest lens that shows the first mirrors", focal is None)
        self.focal: Any = gui.add_slider("focal length (px)", 100.0, 6000.0, 1.0, float(focal or 1000.0))
        for control in (self.faces, self.focal, self._fit):
            control.on_update(lambda _: self._changed.set())
        self._sensor: Any = gui.add_image(blank(WIDTH, 360), label="sensor", format="png")
        self._sphere: Any = gui.add_image(blank(WIDTH, 240), label="directions seen", format="png")
        self.button: Any = gui.add_button("Save this rig")
        self._saved = gui.add_markdown("")
        self.button.on_click(lambda _: self.save())

    def save(self) -> None:
        """What the button does: save the rig shown, and say where."""
        try:
            self._saved.content = self._save(self.spec)
        except FacetcamError as error:
            self._saved.content = f"**Not saved:** {error}"

    def _touch_depth(self, _: object) -> None:
        self._touched_depth = True
        self._changed.set()

    def _draw_scene(self, rig: Rig, areas: dict[str, Area]) -> None:
        scene, drawn = self.server.scene, set()
        last = {view.mirrors[-1]: i for i, view in enumerate(rig.views.values()) if view.mirrors}
        with self.server.atomic():
            for name, mirror in rig.mirrors.items():
                if mirror.polygon is None:
                    continue
                count = len(mirror.polygon)
                faces = np.array([(0, i, i + 1) for i in range(1, count - 1)])
                colour = rgb(view_colour(last[name])) if name in last else (150, 158, 170)
                path = f"/mirrors/{name}"
                scene.add_mesh_simple(
                    path, _SIZE * mirror.polygon, faces, color=colour, opacity=0.55, side="double"
                )
                drawn.add(path)
            polygons = [m.polygon for m in rig.mirrors.values() if m.polygon is not None]
            size = float(np.ptp(np.vstack(polygons), axis=0).max())
            for index, (name, area) in enumerate(areas.items()):
                segments = np.concatenate([_segments(ray_path(rig, ray, 0.6 * size)) for ray in _rays(area)])
                path = f"/rays/{name}"
                scene.add_line_segments(
                    path, _SIZE * segments, rgb(view_colour(index)), thickness=2.0, thickness_units="screen"
                )
                centre = _SIZE * rig.T_rig_image(name)[:3, 3]
                scene.add_icosphere(
                    f"/centres/{name}", radius=0.03, color=rgb(view_colour(index)), position=centre
                )
                drawn |= {path, f"/centres/{name}"}
            body = self.spec.body
            box = _SIZE * np.array([body.width, body.height, body.depth])
            behind = _SIZE * (rig.T_rig_cam @ (0.0, 0.0, -body.depth / 2, 1.0))[:3]
            # The family's cameras look straight down: their bodies stand square in the rig.
            scene.add_box("/camera", color=(74, 83, 98), dimensions=tuple(box.tolist()), position=behind)
            for gone in self._drawn - drawn:
                scene.remove_by_name(gone)
        self._drawn = drawn


def _rays(area: Area) -> list[Array]:
    """A ray (3,) amid the largest piece of a view, and some near its corners."""
    cone = max(area.cones, key=solid_angle)
    middle = cone.mean(axis=0)
    rays = [middle, *(middle + 0.93 * (corner - middle) for corner in cone[:: max(1, len(cone) // _RAYS)])]
    return [ray / np.linalg.norm(ray) for ray in rays]


def _segments(path: Array) -> Array:
    return np.stack([path[:-1], path[1:]], axis=1)
