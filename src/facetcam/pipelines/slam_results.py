"""What a SLAM run writes at its end: final poses, map, summary and report."""

from __future__ import annotations

import resource
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from facetcam.errors import FacetcamError
from facetcam.evaluation import trajectory as evaluation
from facetcam.io.colmap_model import write_colmap_model
from facetcam.io.outputs import atomic_write, each_tried
from facetcam.io.ply import write_ply
from facetcam.io.trajectories import write_tum
from facetcam.pipelines.inputs import SlamInputs
from facetcam.pipelines.slam_maps import MapKeeper
from facetcam.pipelines.slam_record import WAY, SlamRecord, way_in
from facetcam.pipelines.summary import Summary
from facetcam.slam import Slam, Status
from facetcam.slam.camera.nuisances import CREEP_SIGMA
from facetcam.viz.pages import write_slam_report
from facetcam.viz.report import SlamReport, Truth

Array = NDArray[np.float64]
Trajectory = tuple[Array, Array]

REFINED_RIG = "rig_refined.yaml"
ALIGNED_WITHIN = 0.02  # seconds between an estimated and a true pose that are compared


@dataclass(frozen=True, slots=True)
class SlamResults:
    """A run in numbers, and as its report shows it."""

    summary: Summary
    report: SlamReport


def write_results(record: SlamRecord, slam: Slam, inputs: SlamInputs, interrupted: str = "") -> SlamResults:
    """Write the final trajectory in place of the live one, the map, the summary and the report.

    Raises
    ------
    OutputError
        If one of them cannot be written; all others, and the live states, stay.
    """
    seconds = record.seconds
    slam.settle()  # a run that was cut short has not
    path, cloud = slam.trajectory(), slam.cloud()
    keeper = MapKeeper(slam, inputs.maps, record.folder)
    with each_tried() as tried:
        tried(lambda: write_ways(record.folder, path, slam.trajectories_apart()))
        tried(lambda: write_ply(record.folder / "map.ply", *cloud))
        tried(
            lambda: write_colmap_model(record.folder / "colmap", slam.rig_as_seen, slam.rig_frames(), *cloud)
        )
        if slam.rig_refinement is not None:
            tried(lambda: slam.rig.save(record.folder / REFINED_RIG))
        saved = keeper.path if tried(keeper.save) else None
        tried(keeper.save_apart)
        summary = summarise(record, slam, inputs, path, seconds, interrupted, saved)
        tried(lambda: atomic_write(record.folder / "summary.json", summary.to_json()))
        report = make_report(record, slam, inputs, path, summary)
        tried(lambda: write_slam_report(report, summary.report))
    return SlamResults(summary, report)


def write_ways(folder: Path, path: Trajectory, apart: dict[int, Trajectory]) -> None:
    """Write the final poses, and those in maps that never met that of the path, in place of the live ones.

    Live poses stay until all final ones are written.
    """
    ways = {way_in(number): way for number, way in apart.items()}
    for name, way in {**ways, WAY: path}.items():
        write_tum(folder / name, *way)
    for live in folder.glob(way_in("*")):
        if live.name not in ways:
            live.unlink()


def summarise(
    record: SlamRecord,
    slam: Slam,
    inputs: SlamInputs,
    path: Trajectory,
    seconds: float,
    interrupted: str,
    saved_map: Path | None,
) -> Summary:
    """The run in numbers."""
    warnings = [*inputs.source.warnings, *doubts(slam, inputs)]
    warnings += drop_warning(record, slam.dropped, inputs.source.live)
    errors = None
    if inputs.truth is not None:
        try:
            errors = evaluation.evaluate(path, inputs.truth, ALIGNED_WITHIN)
        except FacetcamError as error:
            warnings.append(f"no comparison with the truth: {error}")
    return Summary(
        source=inputs.source.name,
        rig=str(inputs.rig_path),
        out=record.folder,
        frames=record.frames,
        tracked=count_tracked(record, path[0], *(times for times, _ in slam.trajectories_apart().values())),
        statuses=dict(Counter(note.status.value for note in record.notes)),
        metric=slam.metric,
        scale_sigma=slam.scale_sigma if np.isfinite(slam.scale_sigma) else None,
        drawn_scale_sigma=slam.drawn_scale_sigma,
        keyframes=len(slam.keyframe_poses),
        map_points=len(slam.cloud()[0]),
        loops=slam.loops,
        map=slam.map_number,
        maps_apart={number: len(times) for number, (times, _) in slam.trajectories_apart().items()},
        saved_map=saved_map,
        readout_s=float(slam.nuisances[0]),
        creep_px=(float(slam.nuisances[1]), float(slam.nuisances[2])),
        rig_moved=None if slam.rig_refinement is None else slam.rig_refinement.moved,
        path_length=evaluation.path_length(path[1][:, :3, 3]),
        seconds=seconds,
        frames_per_second=record.frames / seconds,
        peak_memory_mb=peak_memory_mb(),
        warnings=tuple(warnings),
        errors=errors,
        interrupted=interrupted,
    )


def doubts(slam: Slam, inputs: SlamInputs) -> list[str]:
    """What the images say against the rig and the odometry."""
    found = [said for said in (slam.rig_check.complaint, slam.rig_check.remark) if said]
    if inputs.config.refine_rig and slam.rig_refinement is None and not inputs.maps.localize:
        found.append("the rig was not refined: the map has too few keyframes")
    if inputs.odometry_offset:
        side = "ahead of" if inputs.odometry_offset > 0 else "behind"
        seconds = abs(inputs.odometry_offset)
        found.append(f"the odometry's clock is {seconds:.2f} s {side} the film's; corrected")
    creep = float(np.linalg.norm(slam.nuisances[1:]))
    if creep > 2.0 * CREEP_SIGMA:
        found.append(f"the camera has crept by {creep:.1f} px against its mirrors; calibrate the rig again")
    if apart := slam.trajectories_apart():
        ways = ", ".join(f"{way_in(number)} ({len(times)} poses)" for number, (times, _) in apart.items())
        found.append(f"lost for good, the rig began another map that never met that of the path: {ways}")
    if slam.odometry_check.complaint:
        found.append(f"odometry not used: {slam.odometry_check.complaint}")
    return found


def drop_warning(record: SlamRecord, dropped: int, live: bool) -> list[str]:
    """One line where frames were left out to keep up, by tracking or by a camera that could not wait."""
    missed = record.offered - record.frames if live else 0
    if not dropped + missed:
        return []
    return [f"{dropped + missed} of {record.frames + missed} frames were dropped to keep up with real time"]


def count_tracked(record: SlamRecord, *times: Array) -> int:
    """Frames whose pose was measured, then or, at the start, later, in whatever map."""
    placed = set(np.concatenate(times).tolist())
    unmeasured = (Status.LOST, Status.DEAD_RECKONING, Status.DROPPED)
    return sum(note.timestamp in placed and note.status not in unmeasured for note in record.notes)


def make_report(
    record: SlamRecord, slam: Slam, inputs: SlamInputs, path: Trajectory, summary: Summary
) -> SlamReport:
    """The run as the report page wants it."""
    times, poses = path
    truth = None
    if inputs.truth is not None and summary.errors is not None:
        # The page draws errors pose by pose, so it gets only the poses that have a true one.
        own, true = evaluation.associate(times, inputs.truth[0], ALIGNED_WITHIN)
        times, poses = times[own], poses[own]
        truth = aligned_truth(inputs.truth[1][true], poses, summary)
    shape = (record.frames, len(record.view_names))
    return SlamReport(
        title=Path(inputs.source.name).name,
        view_names=record.view_names,
        times=np.array([note.timestamp for note in record.notes]),
        statuses=[note.status.value for note in record.notes],
        predicted=np.array([note.predicted for note in record.notes], int).reshape(shape),
        inliers=np.array([note.inliers for note in record.notes], int).reshape(shape),
        tracked=summary.tracked,
        metric=summary.metric,
        scale_sigma=slam.scale_sigma,
        pose_times=times,
        positions=poses[:, :3, 3],
        keyframes=slam.keyframe_poses[:, :3, 3],
        cloud=slam.cloud()[0],
        apart=named_ways(slam.trajectories_apart()),
        timing=slam.timing,
        pictures=record.pictures.items(),
        truth=truth,
        rig_denied=not slam.rig_check.fits,
        interrupted=summary.interrupted,
        facts=facts(summary),
    )


def named_ways(apart: dict[int, Trajectory]) -> dict[str, tuple[Array, Array]]:
    """Times and positions of the paths in maps apart, named for the report; empty ones left out."""
    return {
        f"map {number}: {len(times)} poses, {times[0]:.1f} to {times[-1]:.1f} s": (times, poses[:, :3, 3])
        for number, (times, poses) in apart.items()
        if len(times)
    }


def aligned_truth(truth: Array, estimate: Array, summary: Summary) -> Truth | None:
    """The true positions laid over the estimated ones: with scale where the estimate has none of its own."""
    if summary.errors is None:
        return None
    positions, target = truth[:, :3, 3], estimate[:, :3, 3]
    alignment = evaluation.align(positions, target, with_scale=not summary.metric)
    errors = evaluation.position_errors(target, positions, with_scale=not summary.metric)
    return Truth(
        positions=alignment.apply(positions),
        errors=errors,
        ate=summary.errors.ate.rmse,
        ate_scaled=summary.errors.ate_scaled.rmse,
        with_scale=not summary.metric,
    )


def facts(summary: Summary) -> dict[str, str]:
    """Further rows of the report's summary."""
    rows = {
        "source": summary.source,
        "rig": summary.rig,
        "path length": f"{summary.path_length:.2f} {'m' if summary.metric else 'units of the map'}",
        "speed": f"{summary.frames_per_second:.1f} frames/s, decoding included",
        "peak memory": f"{summary.peak_memory_mb:.0f} MB",
    }
    if summary.errors is not None:
        rows["scale error"] = f"{100 * summary.errors.scale_error:+.2f} %"
    rows |= summary.if_drawn | summary.corrections
    rows["loops closed"] = str(summary.loops)
    if summary.saved_map is not None:
        rows["map"] = str(summary.saved_map)
    return rows | {f"warning {i}": text for i, text in enumerate(summary.warnings, start=1)}


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far."""
    unit = 1 if sys.platform == "darwin" else 1024  # the same call answers in bytes there
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
