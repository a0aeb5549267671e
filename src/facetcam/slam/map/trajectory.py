"""The poses of all frames: hung on keyframes, so that they follow the map, and solved again in the end."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.camera.optics import Optics
from facetcam.slam.camera.pose import refine_pose
from facetcam.slam.camera.shutter import at_one_moment
from facetcam.slam.map.map import Keyframe, Map
from facetcam.slam.map.measure import Measurements
from facetcam.slam.map.pose_graph import Edges, relax

Array = NDArray[np.float64]

_NEAR = 0.3  # seconds within which a motion goes on
_RECENT = 1000  # frames
_HELD = 100.0  # times as stiff as a step of the wheels is what sight says of both ends
_LEAST_SEEN = 20  # points of a frame that the map must still have for its pose to be solved again


@dataclass(frozen=True, slots=True)
class _Seen:
    """Points that agreed with the pose of a frame, in little memory."""

    point: NDArray[np.int32]
    view: NDArray[np.int8]
    pixels: NDArray[np.float32]

    @classmethod
    def of(cls, seen: Measurements) -> Self:
        return cls(seen.point.astype(np.int32), seen.view, seen.pixels.astype(np.float32))

    def take(self, rows: NDArray[np.bool_]) -> _Seen:
        return _Seen(self.point[rows], self.view[rows], self.pixels[rows])


@dataclass(frozen=True, slots=True)
class _Hung:
    timestamp: float
    keyframe: Keyframe
    T_keyframe_rig: Array
    scale: float  # of the keyframe when the pose was found
    seen: _Seen | None = None
    T_before: Array | None = None  # what the wheels say of the way since the frame before

    def renumbered(self, ids_ahead: int) -> _Hung:
        if self.seen is None:
            return self
        return replace(self, seen=replace(self.seen, point=self.seen.point + np.int32(ids_ahead)))

    def T_world_rig(self) -> Array:
        T = self.T_keyframe_rig.copy()
        T[:3, 3] *= self.keyframe.scale / self.scale
        return self.keyframe.T_world_rig @ T


@dataclass(slots=True)
class Trajectory:
    """Frames with a pose."""

    _frames: list[_Hung] = field(default_factory=list)

    def add(
        self,
        timestamp: float,
        T_world_rig: Array,
        keyframe: Keyframe,
        seen: Measurements | None = None,
        T_before: Array | None = None,
    ) -> None:
        """Hang the pose of a frame on a keyframe, and what it has been found by.

        `T_before` is given where only wheels led there from the frame before.
        """
        T = se3.inverse(keyframe.T_world_rig) @ T_world_rig
        kept = None if seen is None else _Seen.of(seen)
        self._frames.append(_Hung(timestamp, keyframe, T, keyframe.scale, kept, T_before))

    def moved_out(self) -> Trajectory:
        """All frames, which are in this trajectory no more."""
        other = Trajectory(self._frames)
        self._frames = []
        return other

    def join(self, earlier: Trajectory, ids_ahead: int) -> None:
        """Take in the frames of another map; their points' ids are larger here."""
        self._frames = [f.renumbered(ids_ahead) for f in earlier._frames] + self._frames
        self._frames.sort(key=lambda f: f.timestamp)

    def rehang(self, keyframe: Keyframe) -> None:
        """Let the frame that has become a keyframe follow itself."""
        for i in range(len(self._frames) - 1, -1, -1):
            if self._frames[i].timestamp == keyframe.timestamp:
                before = self._frames[i].T_before
                self._frames[i] = _Hung(
                    keyframe.timestamp, keyframe, np.eye(4), keyframe.scale, T_before=before
                )
                return

    def forget_after(self, timestamp: float) -> None:
        """Forget the frames after one."""
        self._frames = [f for f in self._frames if f.timestamp <= timestamp]

    def forget_reckoned(self) -> None:
        """Forget the frames since sight placed one."""
        while (
            len(self._frames) > 1 and self._frames[-1].T_before is not None and self._frames[-1].seen is None
        ):
            self._frames.pop()

    def velocity(self, timestamp: float) -> Array:
        """Right-hand twist (6,) a second at a recent frame, from its neighbours in time; zero without any."""
        near = [f for f in self._frames[-_RECENT:] if abs(f.timestamp - timestamp) < _NEAR]
        near.sort(key=lambda f: f.timestamp)
        at = bisect_left(near, timestamp, key=lambda f: f.timestamp)
        return _velocity(near[max(at - 1, 0) : at + 2])

    def solve_again(self, map: Map, optics: Optics, sigma: float) -> None:
        """Find each pose again from what the frame saw, in the map as it has become."""
        self._frames.sort(key=lambda f: f.timestamp)
        for i, frame in enumerate(self._frames):
            seen = None if frame.seen is None else frame.seen.take(map.points.alive[frame.seen.point])
            if seen is not None and len(seen.point) >= _LEAST_SEEN:
                about = self._frames[max(i - 1, 0) : i + 2]
                velocity = _velocity([f for f in about if abs(f.timestamp - frame.timestamp) < _NEAR])
                T = _found_again(frame.T_world_rig(), velocity, seen, map, optics, sigma)
                self._frames[i] = _hung_at(frame, T)

    def close_gaps(self) -> None:
        """Bend each way that only wheels have measured until it ends where sight found the rig again."""
        reckoned = [f.T_before is not None and f.keyframe.timestamp != f.timestamp for f in self._frames]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], reckoned, [False]]).astype(int)))
        for first, end in zip(edges[::2], edges[1::2]):
            steps = [f.T_before for f in self._frames[first : end + 1] if f.T_before is not None]
            if first == 0 or len(steps) <= end - first:  # no sight before, or after
                continue
            bent = _bent(self._frames[first - 1].T_world_rig(), steps, self._frames[end].T_world_rig())
            for i, T in enumerate(bent, first):
                self._frames[i] = _hung_at(self._frames[i], T)

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def last_timestamp(self) -> float:
        """Time of the frame added last."""
        return self._frames[-1].timestamp

    @property
    def last_keyframe(self) -> Keyframe:
        """The keyframe that the frame added last hangs on."""
        return self._frames[-1].keyframe

    def last(self) -> Array:
        """Pose (4, 4) of the frame added last, as the map sees it now."""
        return self._frames[-1].T_world_rig()

    def clear(self) -> None:
        """Forget all frames."""
        self._frames.clear()

    def poses(self) -> tuple[Array, Array]:
        """Timestamps (N,) and best current poses (N, 4, 4), in time order."""
        frames = sorted(self._frames, key=lambda f: f.timestamp)
        poses = np.array([f.T_world_rig() for f in frames]).reshape(-1, 4, 4)
        return np.array([f.timestamp for f in frames]), poses


def _hung_at(frame: _Hung, T_world_rig: Array) -> _Hung:
    T = se3.inverse(frame.keyframe.T_world_rig) @ T_world_rig
    return replace(frame, T_keyframe_rig=T, scale=frame.keyframe.scale)


def _bent(start: Array, steps: list[Array], end: Array) -> Array:
    """Poses of a chain of measured steps (N, 4, 4) from `start`, all but the last, which is held at `end`."""
    poses = [start]
    for step in steps:
        poses.append(poses[-1] @ step)
    nodes = np.arange(len(poses))
    chain = Edges.between(nodes[:-1], nodes[1:], np.stack(poses))
    closed = chain.plus(0, nodes[-1], se3.inverse(start) @ end, 1.0, _HELD)
    return relax(np.stack(poses), closed, with_scale=False)[0][1:-1]


def _velocity(frames: list[_Hung]) -> Array:
    """Right-hand twist (6,) a second from the first to the last of some frames; zero without two."""
    if len(frames) < 2:
        return np.zeros(6)
    T = se3.inverse(frames[0].T_world_rig()) @ frames[-1].T_world_rig()
    return np.asarray(se3.log(T) / (frames[-1].timestamp - frames[0].timestamp))


def _found_again(T: Array, velocity: Array, seen: _Seen, map: Map, optics: Optics, sigma: float) -> Array:
    """Pose from points that the map still has."""
    xyz, pixels = map.points.xyz[seen.point], seen.pixels.astype(np.float64)
    plane = at_one_moment(T, velocity, xyz, seen.view, pixels, map.readout, optics)
    sights = map.points.sights(seen.point, seen.view, plane, T, optics)
    return refine_pose(T, sights, optics, sigma, settled=True).T_world_rig
