"""A run in the browser: the map, the path, and the rig at any of its frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from facetcam.design.extras import need

if TYPE_CHECKING:
    from viser import ViserServer

Array = NDArray[np.float64]

COLOURS = {"TRACKING": (47, 158, 68), "DEAD_RECKONING": (240, 140, 0), "STARTING": (25, 113, 194)}
_OTHER = (201, 42, 42)
_POINT = 0.018  # of the map's height, the size of a point
_SHARE = (2.0, 98.0)  # percentiles between which the map counts for the first look
_AXES = 0.08  # of the path's extent, the length of the rig's axes


@dataclass(frozen=True, slots=True)
class Moment:
    """One frame: its time, what was said of it, its pose (4, 4) if it has one, points seen and expected."""

    time: float
    status: str
    keyframe: bool
    T_world_rig: Array | None
    seen: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True)
class ShownRun:
    """What the page shows: frames, map points (N, 3) with RGB colours, and what is known of the scale."""

    name: str
    moments: list[Moment]
    points: Array
    colours: NDArray[np.uint8]
    scale: str


class RunPage:
    """The page of one run. The slider moves the rig along its path; words beside it say what it saw there.

    Parameters
    ----------
    run : ShownRun
        At least one of its moments has a pose.
    port : int
        Of the local web server; the next free one is taken if it is busy.

    Raises
    ------
    FacetcamError
        If viser is not installed.
    """

    def __init__(self, run: ShownRun, port: int = 8080) -> None:
        need("viser")
        import viser

        self.run = run
        self.server: ViserServer = viser.ViserServer("127.0.0.1", port, label="facetcam view", verbose=False)
        self._posed = [k for k, moment in enumerate(run.moments) if moment.T_world_rig is not None]
        self._axes = _AXES * float(np.ptp(self._positions(), axis=0).max() + 1.0)
        self._add_controls()
        self._draw()
        self.show(self._posed[-1])

    @property
    def address(self) -> str:
        """Where the browser finds it."""
        return f"http://127.0.0.1:{self.server.get_port()}"

    def stop(self) -> None:
        """Close the page."""
        self.server.stop()

    def show(self, index: int) -> None:
        """Put the rig where it was in a frame, and say what it saw; without a pose it stays where it was."""
        moment = self.run.moments[index]
        self.words.content = describe(moment, index, len(self.run.moments))
        if moment.T_world_rig is not None:
            self.rig.position = moment.T_world_rig[:3, 3]
            self.rig.wxyz = _wxyz(moment.T_world_rig)

    def _positions(self) -> Array:
        poses = [self.run.moments[k].T_world_rig for k in self._posed]
        return np.array([pose[:3, 3] for pose in poses if pose is not None])

    def _add_controls(self) -> None:
        gui, run = self.server.gui, self.run
        gui.add_markdown(f"**{run.scale}**")
        gui.add_markdown(f"`{run.name}`: {len(run.moments)} frames, {len(run.points)} map points")
        last = max(len(run.moments) - 1, 1)
        self.slider: Any = gui.add_slider("frame", 0, last, 1, self._posed[-1])
        self.slider.on_update(lambda _: self.show(min(int(self.slider.value), len(run.moments) - 1)))
        self.words: Any = gui.add_markdown("")
        size: Any = gui.add_slider("size of points", 0.2, 5.0, 0.1, 1.0)
        size.on_update(lambda _: setattr(self._cloud, "point_size", self._point * size.value))

    def _draw(self) -> None:
        scene, run, path = self.server.scene, self.run, self._positions()
        extent = run.points if len(run.points) else path
        low, high = np.percentile(extent, _SHARE, axis=0)
        middle, reach = (low + high) / 2, float((high - low).max()) + 4.0 * self._axes
        self._point = _POINT * max(float(high[2] - low[2]), self._axes)
        self._cloud: Any = scene.add_point_cloud("/map", run.points, run.colours, point_size=self._point)
        shown = [run.moments[k] for k in self._posed]
        colours = np.array([COLOURS.get(moment.status, _OTHER) for moment in shown], np.uint8)
        scene.add_line_segments(
            "/path",
            np.stack([path[:-1], path[1:]], axis=1),
            np.stack([colours[1:], colours[1:]], axis=1),
            thickness=5.0,
            thickness_units="screen",
        )
        keyframes = [m.T_world_rig for m in shown if m.keyframe and m.T_world_rig is not None]
        if keyframes:
            scene.add_batched_axes(
                "/keyframes",
                np.array([_wxyz(T) for T in keyframes]),
                np.array([T[:3, 3] for T in keyframes]),
                axes_length=0.4 * self._axes,
                axes_radius=0.02 * self._axes,
            )
        self.rig: Any = scene.add_frame("/rig", axes_length=self._axes, axes_radius=0.06 * self._axes)
        self.server.initial_camera.position = middle + reach * np.array([0.0, -0.45, 0.6])
        self.server.initial_camera.look_at = middle


def describe(moment: Moment, index: int, count: int) -> str:
    """What is known of a frame, in markdown."""
    kind = ", keyframe" if moment.keyframe else ""
    lines = [f"frame {index} of {count}, {moment.time:.3f} s: **{moment.status}**{kind}"]
    if moment.T_world_rig is not None:
        x, y, z = moment.T_world_rig[:3, 3]
        lines.append(f"x {x:.3f}, y {y:.3f}, z {z:.3f}")
    if any(expected for _, expected in moment.seen.values()):
        lines += ["| view | seen | expected |\n|---|---|---|"]
        lines[-1] += "".join(f"\n| {view} | {n} | {m} |" for view, (n, m) in moment.seen.items())
    return "\n\n".join(lines)


def _wxyz(T: Array) -> Array:
    return np.asarray(Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True))
