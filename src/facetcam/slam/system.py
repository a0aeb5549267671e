"""Visual SLAM through mirrors: one frame in, one state out."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, MapError
from facetcam.io.colmap_model import RigFrame
from facetcam.rig import Rig
from facetcam.slam.camera.frame import Frame, make_frame
from facetcam.slam.config import SlamConfig
from facetcam.slam.main_loop import MainLoop
from facetcam.slam.map import outputs
from facetcam.slam.map.file import MapHeader
from facetcam.slam.parts import Parts
from facetcam.slam.rig_check.refinement import RigRefinement, refine_rig
from facetcam.slam.state import State, Status
from facetcam.slam.stopwatch import Stopwatch
from facetcam.slam.threads import Background, Pace
from facetcam.slam.tracking.motion import Motion
from facetcam.slam.wheels import Wheels

Array = NDArray[np.float64]


class Slam:
    """Tracks a mirror rig and maps what it sees.

    With `SlamConfig.real_time` the map grows in a thread of its own, and frames that come too fast are
    dropped; else every run gives the same result. Any thread may call it: calls are taken one after another.

    Parameters
    ----------
    rig : Rig
    config : SlamConfig, optional

    Attributes
    ----------
    rig_check : RigCheck
        Whether the rig's file and the film belong together.
    rig_refinement : RigRefinement or None
        How `finish` moved the rig's numbers, with `SlamConfig.refine_rig`; `rig` is the refined one then.
    drawn_scale_sigma : float or None
        After `finish`, the sigma of a metric map's scale if the rig was built with care after its drawing;
        None for a rig with a covariance of its own.
    odometry_check : OdometryCheck
        Whether odometry and the film belong together, and on one clock; it is used no more where not.
    dropped : int
        Frames dropped to keep up with real time.
    timing : dict of str to list of float
        Seconds of each stage, call by call.

    Examples
    --------
    >>> slam = Slam(Rig.load("rig.yaml"))
    >>> for frame in source:
    ...     state = slam.track(frame.image, frame.timestamp)
    >>> slam.finish()
    >>> timestamps, poses = slam.trajectory()
    """

    def __init__(self, rig: Rig, config: SlamConfig | None = None) -> None:
        self.rig = rig
        self.config = config or SlamConfig()
        self._stopwatch = Stopwatch()
        self._parts = parts = self._assemble()
        self._map, self._grower = parts.map, parts.grower
        self._motion = Motion()
        self._mapping = Background(self.config.real_time)
        self._checking = Background(self.config.real_time)
        self._wheels = Wheels(parts, self._motion, self._mapping)
        self._loop = MainLoop(parts, self._motion, self.config, self._mapping, self._stopwatch)
        self.rig_check = parts.rig_check
        self.rig_refinement: RigRefinement | None = None
        self.drawn_scale_sigma: float | None = None
        self.odometry_check = self._wheels.check
        self.dropped = 0
        self.timing = self._stopwatch.seconds
        self._calls = threading.Lock()
        self._pace = Pace()
        self._last_timestamp = -np.inf
        self._earlier_loops = 0

    def _assemble(self) -> Parts:
        """The parts; benchmarks put others in."""
        return Parts.assemble(self.rig, self.config)

    def track(self, image: NDArray[np.generic], timestamp: float, odometry: ArrayLike | None = None) -> State:
        """Take one raw frame and tell where the rig is.

        Parameters
        ----------
        image : (H, W) or (H, W, 3) array of uint8 or uint16
            Raw frame, grey or BGR, of the size of the rig's camera.
        timestamp : float
            Seconds, later than the one before.
        odometry : (3,) array, optional
            x, y in metres and yaw in radians in a drifting frame; the robot's x axis is the rig's +y.

        Returns
        -------
        State

        Raises
        ------
        FacetcamError
            If the frame does not fit the rig, the time does not increase or odometry is not three numbers.
        """
        with self._calls:
            self._mapping.check()
            self._require_later(timestamp)
            wheels = self._wheels.taken(odometry)
            with self._stopwatch.timed("frame"):
                frame = make_frame(image, timestamp, self.rig.size)
            self._last_timestamp = timestamp
            if self.config.real_time and self._pace.behind(timestamp):
                self.dropped += 1
                return State(timestamp, Status.DROPPED, metric=self.metric, scale_sigma=self.scale_sigma)
            if not self._checking.busy:
                self._checking.run(lambda: self._check_rig(frame))
            state = self._loop.take(frame, wheels, self.odometry_check)
            self._wheels.compare(state, wheels, map_grows=not self._loop.localise_only)
            return state

    def _check_rig(self, frame: Frame) -> None:
        with self._stopwatch.timed("check"):
            self.rig_check.offer(frame)

    def _require_later(self, timestamp: float) -> None:
        if not timestamp > (last := self._last_timestamp):
            raise FacetcamError(f"timestamp {timestamp} does not come after {last}; sort the frames")

    def replace_odometry(self, at: Callable[[float], ArrayLike | None]) -> None:
        """Give the keyframes of this run other odometry, for instance after its clock was found to be off.

        Parameters
        ----------
        at : callable
            x, y, yaw at a time, or None.
        """
        with self._calls:
            self._wheels.replace(at)

    def settle(self) -> None:
        """Go over to the map that counts, where a run has several: that of an earlier run, or the longest."""
        with self._calls:
            self._mapping.join()
            self._loop.settle()

    def finish(self) -> None:
        """Adjust the whole map once more and judge its scale; calling it again changes nothing much."""
        with self._calls, self._stopwatch.timed("finish"):
            self._mapping.wait()
            self._checking.wait()
            if self._loop.localise_only:
                return
            self._loop.settle()
            self._grower.adjust_all(last=True)
            if not self.config.refine_rig:
                self.drawn_scale_sigma = self._parts.drawn_scale_sigma(self.config.pixel_sigma)
            self._wheels.conclude()
            if self.config.refine_rig:
                self._refine_rig()
            with self._map.lock:
                trajectory, sigma = self._motion.trajectory, self.config.pixel_sigma
                trajectory.solve_again(self._map, self._parts.optics, sigma)
                trajectory.close_gaps()

    def _refine_rig(self) -> None:
        parts = self._parts
        self.rig_refinement = refine_rig(parts.map, parts.optics, parts.adjuster, self.config.pixel_sigma)
        self.rig_check.refinement = self.rig_refinement
        self.rig = parts.optics.rig
        self._grower.judge()

    def close(self) -> None:
        """Wait until nothing grows the map any more: for runs that end early. The map stays."""
        self._mapping.join()
        self._checking.join()

    def load_map(self, path: Path | str, localise_only: bool = False) -> MapHeader:
        """Go on in a saved map: find the rig there, then extend the map or only tell where the rig is.

        Parameters
        ----------
        path : path
        localise_only : bool
            Leave the map as it is.

        Raises
        ------
        MapError
            If the file cannot be used (missing, no map, newer, damaged, of another rig), or tracking began.
        """
        if self._map.keyframes or np.isfinite(self._last_timestamp):
            raise MapError(f"{path}: a map is loaded before the first frame")
        header = outputs.load(path, self.rig, self._map, self._parts.places, self._parts.optics)
        self._loop.go_on(localise_only)
        self._parts.mapper.session, self._earlier_loops = header.sessions, header.loops
        sigma = np.inf if header.scale_sigma is None else header.scale_sigma
        self._grower.go_on(sigma, sigma)
        return header

    def save_map(self, path: Path | str, number: int | None = None) -> None:
        """Write the map, or the one of that number, as one file in place of an older one.

        Where there are several it is that of an earlier run, else the one in which the rig was longest.
        Raises `OutputError` where it cannot.
        """
        loops, atlas = self._earlier_loops + self.loops, self._parts.atlas
        with self._calls:
            if atlas.left:
                self._mapping.join()  # maps that are about to be one
            apart = (left for left in atlas.left if left.map.number == number)
            kept = next(apart, None) or atlas.main(self._motion.trajectory)
            outputs.save(path, self.rig, kept.map, kept.places, *self._parts.known(kept.scale_sigma), loops)

    @property
    def grown(self) -> bool:
        """True where this run added to the map."""
        keyframes = self._parts.atlas.main(self._motion.trajectory).map.keyframes
        return bool(keyframes) and keyframes[-1].session == self._parts.mapper.session

    @property
    def metric(self) -> bool:
        """True where the images prove the scale of the map, and do not deny the rig that it comes from."""
        return self._parts.metric

    @property
    def scale_sigma(self) -> float:
        """Relative sigma of the map's scale, inf where the images cannot tell it or deny the rig."""
        return self._parts.scale_sigma

    @property
    def nuisances(self) -> Array:
        """Readout of the shutter in seconds, and creep (x, y) of the image in pixels, as estimated."""
        return self._parts.adjuster.nuisances

    @property
    def rig_as_seen(self) -> Rig:
        """The rig with what its camera has crept against the mirrors."""
        return self._parts.optics.rig

    @property
    def loops(self) -> int:
        """Loops closed in this run."""
        return self._grower.loops

    @property
    def keyframe_poses(self) -> Array:
        """Poses (K, 4, 4) of the keyframes."""
        with self._map.lock:
            return self._map.poses()

    def trajectory(self) -> tuple[Array, Array]:
        """Timestamps (N,) and best current poses (N, 4, 4) of all frames that have one, in time order."""
        with self._map.lock:
            return self._motion.trajectory.poses()

    @property
    def map_number(self) -> int:
        """Number of the present map, by `State.map`."""
        return self._map.number

    def trajectories_apart(self) -> dict[int, tuple[Array, Array]]:
        """Timestamps and poses as of `trajectory`, of the maps that never met that one, by `State.map`."""
        with self._map.lock:
            return {left.map.number: left.trajectory.poses() for left in self._parts.atlas.left}

    def cloud(self) -> tuple[Array, NDArray[np.uint8]]:
        """World positions (M, 3) in metres and RGB colours (M, 3) of the map points."""
        return outputs.coloured_cloud(self._map)

    def rig_frames(self) -> list[RigFrame]:
        """What the keyframes saw of the points of `cloud`, whose rows `point` gives."""
        return outputs.sightings_of_keyframes(self._map)
