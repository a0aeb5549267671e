"""From a film to a trajectory, a map and a report."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path

from facetcam.errors import RigError
from facetcam.io.frames import Frame
from facetcam.io.outputs import fresh_folder, require_absent
from facetcam.pipelines.inputs import SlamInputs, read_slam_inputs
from facetcam.pipelines.progress import Progress, keeping, silent, total_frames
from facetcam.pipelines.slam_maps import MapChoice, MapKeeper
from facetcam.pipelines.slam_record import SlamRecord
from facetcam.pipelines.slam_results import SlamResults, write_results
from facetcam.pipelines.summary import Summary
from facetcam.slam import Slam


def run_slam(
    source: Path | str | int,
    rig_path: Path | str,
    out: Path | str,
    *,
    odometry: Path | str | None = None,
    truth: Path | str | None = None,
    settings: Path | str | None = None,
    map_path: Path | str | None = None,
    localize: bool = False,
    fps: float | None = None,
    max_frames: int | None = None,
    real_time: bool = False,
    refine_rig: bool = False,
    progress: Progress = silent,
) -> Summary:
    """Track a film with a rig and write trajectory, states, map, summary and report into a fresh folder.

    Trajectory and states are written as they come. However the run ends, they stay, and the summary says how.

    Parameters
    ----------
    source : path or int
        Film, folder of images, or number of a live camera.
    rig_path : path
        The `rig.yaml` of the film.
    out : path
        Folder to make.
    odometry : path, optional
        Table `timestamp,x,y,yaw`.
    truth : path, optional
        True trajectory (TUM) to compare with.
    settings : path, optional
        YAML file of `SlamConfig`.
    map_path : path, optional
        Map to go on in and to extend, or a new one to make; without it the map is written into `out`.
    localize : bool
        Only tell where the rig is in the map of `map_path`, and leave the map as it is.
    fps : float, optional
        Frame rate that replaces the source's own times.
    max_frames : int, optional
        Stop after so many frames.
    real_time : bool
        Take the frames when they are due, as a robot does, and drop those that come too fast.
    refine_rig : bool
        Let the rig's own numbers move at the end, and write the refined rig as `rig_refined.yaml`.
    progress : callable
        See `facetcam.pipelines.Progress`.

    Raises
    ------
    FacetcamError
        Before `out` is made, if an input is missing, wrong, or does not fit the others; later, if the film
        turns out damaged or a result cannot be written.
    """
    require_absent(out)
    maps = MapChoice(None if map_path is None else Path(map_path), localize)
    inputs = read_slam_inputs(source, rig_path, odometry, truth, settings, fps, max_frames, maps)
    config = inputs.config
    config = replace(
        config, real_time=real_time or config.real_time, refine_rig=refine_rig or config.refine_rig
    )
    inputs = replace(inputs, config=config)
    return track_film(inputs, out, max_frames, progress).summary


def track_film(
    inputs: SlamInputs, out: Path | str, max_frames: int | None = None, progress: Progress = silent
) -> SlamResults:
    """Do the work of `run_slam` on inputs that were read and checked."""
    slam = Slam(inputs.rig, inputs.config)
    inputs.maps.load_into(slam)
    with (
        inputs.source,
        SlamRecord(fresh_folder(out), inputs.rig.view_names) as record,
        keeping(record.folder, lambda reason: write_results(record, slam, inputs, reason)),
        closing(slam),
    ):
        keeper = MapKeeper(slam, inputs.maps, record.folder)
        frames = islice(inputs.source, max_frames)
        for frame in when_due(frames) if inputs.config.real_time else frames:
            state = slam.track(frame.image, frame.timestamp, inputs.odometry_at(frame.timestamp))
            record.add(frame, state)
            require_fit(slam)
            inputs = in_step(slam, inputs)
            keeper.after_frame()
            progress(record.frames, total_frames(inputs.source.count, max_frames))
        slam.finish()
        return write_results(record, slam, inputs)


def require_fit(slam: Slam) -> None:
    """Raise RigError where the rig is not that of the film, unless it is to be refined."""
    if not (slam.rig_check.moves_as_one or slam.config.refine_rig):
        raise RigError(slam.rig_check.complaint)


def in_step(slam: Slam, inputs: SlamInputs) -> SlamInputs:
    """Bring the odometry to the film's clock once its offset is known."""
    check = slam.odometry_check
    if check.offset is None or inputs.odometry_offset:
        return inputs
    inputs = inputs.with_odometry_offset(check.offset)
    slam.replace_odometry(inputs.odometry_at)
    return inputs


def when_due(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Hand out frames at their own pace; one that is late comes at once."""
    start: float | None = None
    for frame in frames:
        if start is None:
            start = time.perf_counter() - frame.timestamp
        time.sleep(max(0.0, start + frame.timestamp - time.perf_counter()))
        yield frame
