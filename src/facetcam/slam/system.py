"""Visual SLAM through mirrors: one frame in, one state out."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from facetcam.errors import FacetcamError, MapError
from facetcam.io.colmap_model import RigFrame
from facetcam.rig import Rig
from facetcam.slam import outputs
from facetcam.slam.config import SlamConfig
from facetcam.slam.frame import Frame, make_frame
from facetcam.slam.localising import Localiser
from facetcam.slam.map_file import MapHeader
from facetcam.slam.motion import Motion
from facetcam.slam.odometry import checked_odometry, planar_pose
from facetcam.slam.odometry_check import OdometryCheck
from facetcam.slam.parts import Parts
from facetcam.slam.rig_refinement import RigRefinement, refine_rig
from facetcam.slam.state import State, Status, ViewHealth
from facetcam.slam.threads import Background, Pace
from facetcam.slam.tracking import Fix
from facetcam.slam.uncertainty import pose_covariance

Array = NDArray[np.float64]

_PATIENCE = 10  # lost frames
_BRIEF = 5.0  # seconds that a map was followed


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
    odometry_check : OdometryCheck
        Whether odometry and the film belong together, and on one clock. Odometry with a complaint is used no
        more, and what it brought into the map is taken out.
    dropped : int
        Frames dropped to keep up with real time.
    given_up : list of float
        Seconds at which a map that had been followed was given up for a new one, in whose frame all later
        poses are.
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
        self.timing: dict[str, list[float]] = defaultdict(list)
        self._parts = parts = self._assemble()
        self._map, self._grower = parts.map, parts.grower
        self.rig_check = parts.rig_check
        self.rig_refinement: RigRefinement | None = None
        self.odometry_check = OdometryCheck()
        self.dropped = 0
        self.given_up: list[float] = []
        self._calls = threading.Lock()
        self._mapping = Background(self.config.real_time)
        self._checking = Background(self.config.real_time)
        self._pace = Pace()
        self._motion = Motion()
        n_views = parts.optics.n_views
        self._localiser = Localiser(self._map, parts.tracker, self._motion, self.config, n_views)
        self._last_timestamp = -np.inf
        self._continued = False  # a map of an earlier run
        self._localise_only = False
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
            wheels = None if self.odometry_check.complaint else checked_odometry(odometry)
            with self._timed("frame"):
                frame = make_frame(image, timestamp, self.rig.size)
            self._last_timestamp = timestamp
            if self.config.real_time and self._pace.behind(timestamp):
                self.dropped += 1
                return State(timestamp, Status.DROPPED, metric=self.metric, scale_sigma=self.scale_sigma)
            if not self._checking.busy:
                self._checking.run(lambda: self._check_rig(frame))
            if self._parts.mapper.denied and self._young:
                self._forget()
            state = self._follow(frame, wheels) if self._map.keyframes else self._start(frame, wheels)
            self._motion.odometry = wheels
            tracked = state.T_world_rig if state.status is Status.TRACKING else None
            self.odometry_check.offer(timestamp, tracked, wheels, self.metric)
            if wheels is not None and self.odometry_check.complaint:
                self._refuse_odometry()
            return state

    def _refuse_odometry(self) -> None:
        """Go on by sight alone, and take out of the map what the wheels brought into it."""
        self._give_odometry(lambda _: None)
        if not self._localise_only:
            self._mapping.run(lambda: self._grower.adjust_all(last=True))

    def _check_rig(self, frame: Frame) -> None:
        with self._timed("check"):
            self.rig_check.offer(frame)

    def _require_later(self, timestamp: float) -> None:
        if not timestamp > self._last_timestamp:
            raise FacetcamError(
                f"timestamp {timestamp} does not come after {self._last_timestamp}; sort the frames"
            )

    def _follow(self, frame: Frame, odometry: Array | None) -> State:
        """Predict, measure the map in every view, solve the pose, and grow the map where it is due."""
        grows = not self._localise_only and not self._mapping.busy
        with self._map.lock:
            with self._timed("track"):
                fix = self._localiser.find(frame, odometry, self.odometry_check.agrees, grows)
            if fix is not None and self._motion.lost_frames:
                self._parts.resumer.forget()
            due = fix is not None and self._localiser.accept(frame, fix, odometry)
        if fix is None:
            return self._miss(frame, odometry)
        keyframe = due and grows
        if keyframe:
            self._mapping.run(lambda: self._grow(frame, fix, odometry))
        return self._state(frame, fix, keyframe)

    def _grow(self, frame: Frame, fix: Fix, odometry: Array | None) -> None:
        with self._timed("map"):
            self._grower.grow(frame, fix, odometry, self._motion.trajectory)

    def _miss(self, frame: Frame, odometry: Array | None) -> State:
        """No pose from the images: follow the wheels, or say that the rig is lost."""
        self._motion.lose(odometry, self.odometry_check.agrees)
        self._localiser.doubt()
        if self._gives_up(frame):
            self.given_up += [] if self._young else [frame.timestamp]
            self._forget()
            return self._start(frame, odometry)
        with self._map.lock:
            last = self._map.keyframes[-1]
            T = self._motion.roll(frame.timestamp, odometry, self.config.odometry_sigma, last)
        if T is None:
            return State(frame.timestamp, Status.LOST, map_points=self._n_points)
        if self._resumes(frame, odometry, T):
            return self._begun(frame, self._motion.trajectory.last(), self._motion.covariance)
        covariance = self._motion.covariance
        return State(frame.timestamp, Status.DEAD_RECKONING, T, covariance, map_points=self._n_points)

    def _resumes(self, frame: Frame, odometry: Array | None, T_world_rig: Array) -> bool:
        """Go on with the map from where the wheels have carried the rig, once two frames show enough."""
        if self._localise_only or odometry is None:
            return False
        with self._timed("start"):
            start = self._parts.resumer.offer(frame, odometry)
        if start is None:
            return False
        self._mapping.wait()
        start = self._parts.resumer.carry_over(start, T_world_rig, self._motion.covariance)
        self._motion.resume(start)
        self._localiser.trust_again()
        return True

    @property
    def _young(self) -> bool:
        return self._map.young and not self._continued

    def _gives_up(self, frame: Frame) -> bool:
        """Tell whether a lost map was wrong, or so brief that a new one serves better than waiting for it."""
        if self._motion.lost_frames <= _PATIENCE or self._continued:
            return False
        followed, lost = self._motion.trajectory.since(frame.timestamp)
        return self._map.young or followed < min(lost, _BRIEF)

    def _forget(self) -> None:
        """A map that fails this early was wrong: forget it with its poses."""
        self._mapping.wait()
        self._grower.start_again()
        self._parts.resumer.forget()
        self._motion.forget()

    def _start(self, frame: Frame, odometry: Array | None) -> State:
        """Wait for two frames that can start the map."""
        with self._timed("start"):
            start = self._parts.starter.offer(frame, odometry)
        if start is None:
            return State(
                frame.timestamp, Status.STARTING, None if odometry is None else planar_pose(odometry)
            )
        self._motion.begin(start)
        start.first.measured = start.last.measured = len(start.last.observations)
        return self._begun(frame, start.last.T_world_rig.copy())

    def _begun(self, frame: Frame, T_world_rig: Array, covariance: Array | None = None) -> State:
        """State of a frame with which a map begins, or goes on."""
        return State(
            frame.timestamp,
            Status.TRACKING,
            T_world_rig,
            covariance,
            keyframe=True,
            map_points=self._n_points,
        )

    def _state(self, frame: Frame, fix: Fix, keyframe: bool) -> State:
        expected, inliers = (
            np.bincount(rows.view, minlength=self._parts.optics.n_views)
            for rows in (fix.predictions, fix.seen)
        )
        with self._map.lock:
            trajectory, wheels = self._motion.trajectory, self._motion.odometry is not None
            T_world_rig = trajectory.last()
            near = [trajectory.last_keyframe, *self._map.keyframes[::-1]]
            self._motion.covariance = pose_covariance(
                T_world_rig, fix.pose.covariance, near, self.scale_sigma, wheels
            )
        return State(
            timestamp=frame.timestamp,
            status=Status.TRACKING,
            T_world_rig=T_world_rig,
            covariance=self._motion.covariance,
            views={
                n: ViewHealth(int(e), int(i)) for n, e, i in zip(self._parts.optics.names, expected, inliers)
            },
            keyframe=keyframe,
            metric=self.metric,
            scale_sigma=self.scale_sigma,
            map_points=self._n_points,
            pixels=fix.seen.pixels.astype(np.float32),
            pixel_views=fix.seen.view,
        )

    def replace_odometry(self, at: Callable[[float], ArrayLike | None]) -> None:
        """Give the keyframes of this run other odometry, for instance after its clock was found to be off.

        Parameters
        ----------
        at : callable
            x, y, yaw at a time, or None.
        """
        with self._calls:
            self._give_odometry(at)

    def _give_odometry(self, at: Callable[[float], ArrayLike | None]) -> None:
        self._mapping.wait()
        for keyframe in self._map.keyframes:
            if keyframe.session == self._parts.mapper.session:
                keyframe.odometry = checked_odometry(at(keyframe.timestamp))
        self._motion.odometry = None

    def finish(self) -> None:
        """Adjust the whole map once more and judge its scale; calling it again changes nothing much."""
        with self._calls, self._timed("finish"):
            self._mapping.wait()
            self._checking.wait()
            if not self._localise_only:
                self._grower.adjust_all(last=True)
                self._conclude_odometry()
                if self.config.refine_rig:
                    self._refine_rig()
                with self._map.lock:
                    sigma = self.config.pixel_sigma
                    self._motion.trajectory.solve_again(self._map, self._parts.optics, sigma)
                    self._motion.trajectory.close_gaps()

    def _conclude_odometry(self) -> None:
        known = self.odometry_check.complaint
        self.odometry_check.conclude(self.metric)
        if self.odometry_check.complaint != known:
            self._refuse_odometry()
            self._mapping.wait()

    def _refine_rig(self) -> None:
        parts = self._parts
        self.rig_refinement = refine_rig(parts.map, parts.optics, parts.adjuster, self.config.pixel_sigma)
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
        self._continued, self._localise_only = True, localise_only
        self._localiser.doubt()
        self._parts.mapper.session, self._earlier_loops = header.sessions, header.loops
        self._grower.go_on(np.inf if header.scale_sigma is None else header.scale_sigma)
        return header

    def save_map(self, path: Path | str) -> None:
        """Write the map as one file, in place of an older one; raises `OutputError` where it cannot."""
        loops = self._earlier_loops + self.loops
        outputs.save(path, self.rig, self._map, self._parts.places, self.metric, self.scale_sigma, loops)

    @property
    def grown(self) -> bool:
        """True where this run added to the map."""
        return bool(self._map.keyframes) and self._map.keyframes[-1].session == self._parts.mapper.session

    @property
    def metric(self) -> bool:
        """True where the images prove the scale of the map, and do not deny the rig that it comes from."""
        return self._grower.metric and (self.rig_check.fits or self.rig_refinement is not None)

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the map's scale, inf where the images cannot tell it."""
        return self._grower.scale_sigma

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
    def _n_points(self) -> int:
        return int(np.count_nonzero(self._map.points.alive))

    @property
    def keyframe_poses(self) -> Array:
        """Poses (K, 4, 4) of the keyframes."""
        with self._map.lock:
            return self._map.poses()

    def trajectory(self) -> tuple[Array, Array]:
        """Timestamps (N,) and best current poses (N, 4, 4) of all frames that have one, in time order."""
        with self._map.lock:
            return self._motion.trajectory.poses()

    def cloud(self) -> tuple[Array, NDArray[np.uint8]]:
        """World positions (M, 3) in metres and RGB colours (M, 3) of the map points."""
        return outputs.coloured_cloud(self._map)

    def rig_frames(self) -> list[RigFrame]:
        """What the keyframes saw of the points of `cloud`, whose rows `point` gives."""
        return outputs.sightings_of_keyframes(self._map)

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.timing[stage].append(time.perf_counter() - start)
