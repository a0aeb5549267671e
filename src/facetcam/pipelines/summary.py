"""What a SLAM run amounts to, in numbers."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from facetcam.evaluation.trajectory import TrajectoryErrors

_WORTH_TELLING = 0.1  # px of creep


@dataclass(frozen=True, slots=True)
class Summary:
    """Numbers of a SLAM run, as written to `summary.json`.

    `tracked` counts frames whose pose was measured, those of the start included, which are solved backwards;
    `scale_sigma` is relative, None where the scale is unknown; `drawn_scale_sigma` is that of a rig built
    with care after a drawing, infinite where nothing would be left of it, None where the rig is calibrated or
    the scale unknown; `frames_per_second` includes decoding and the last adjustment; `loops` counts returns
    to a place that were recognised; `map` is the number of the path's map in `states.csv`, and `maps_apart`
    tells how many poses there are in each map that never met it; `saved_map` is None where the run did not
    add to a map; `readout_s` is that of the shutter, zero for a global one; `creep_px` (x, y) tells how far
    the image lies from where the rig's file says; `rig_moved` by how many standard deviations a refinement
    moved each of the rig's numbers, None without one; `errors` need a true trajectory.
    """

    source: str
    rig: str
    out: Path
    frames: int
    tracked: int
    statuses: dict[str, int]
    metric: bool
    scale_sigma: float | None
    drawn_scale_sigma: float | None
    keyframes: int
    map_points: int
    loops: int
    map: int
    maps_apart: dict[int, int]
    saved_map: Path | None
    readout_s: float
    creep_px: tuple[float, float]
    rig_moved: dict[str, float] | None
    path_length: float
    seconds: float
    frames_per_second: float
    peak_memory_mb: float
    warnings: tuple[str, ...]
    errors: TrajectoryErrors | None
    interrupted: str

    @property
    def tracked_percent(self) -> float:
        """Tracked share, rounded down to a tenth so that 100 means every frame."""
        return math.floor(1000 * self.tracked / max(self.frames, 1)) / 10

    @property
    def report(self) -> Path:
        """The page that shows the run."""
        return self.out / "report.html"

    @property
    def if_drawn(self) -> dict[str, str]:
        """What a METRIC scale is worth if the rig's file, which was taken as exact, is only a drawing."""
        sigma = self.drawn_scale_sigma
        if sigma is None or not self.metric:
            return {}
        known = f"± {100 * sigma:.2g} %" if sigma < 1.0 else "unknown"
        return {"if the rig is a drawing": f"{known}: facetcam calibrate measures it"}

    @property
    def corrections(self) -> dict[str, str]:
        """What was found of shutter and camera beyond the rig's file, and taken into account."""
        rows = {}
        if self.readout_s:
            rows["rolling shutter"] = f"{1e3 * self.readout_s:.1f} ms from the first row to the last"
        x, y = self.creep_px
        if math.hypot(x, y) > _WORTH_TELLING:
            rows["camera has crept"] = f"by {x:+.2f}, {y:+.2f} px against its mirrors; corrected"
        return rows

    def to_json(self) -> str:
        """The summary as a JSON text without NaN or infinity."""
        return to_json(self)


def to_json(record: Any) -> str:
    """A dataclass as an indented JSON text; numbers that are not finite become null."""
    return json.dumps(_plain(dataclasses.asdict(record)), indent=2, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
