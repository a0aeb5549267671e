"""The poses of all frames, hung on keyframes so that they follow when the map is adjusted."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from facetcam.geometry import se3
from facetcam.slam.map import Keyframe

Array = NDArray[np.float64]

_NEAR = 0.3  # seconds within which a motion goes on
_RECENT = 1000  # frames


@dataclass(frozen=True, slots=True)
class _Hung:
    timestamp: float
    keyframe: Keyframe
    T_keyframe_rig: Array
    scale: float  # of the keyframe when the pose was found

    def T_world_rig(self) -> Array:
        T = self.T_keyframe_rig.copy()
        T[:3, 3] *= self.keyframe.scale / self.scale
        return self.keyframe.T_world_rig @ T


@dataclass(slots=True)
class Trajectory:
    """Frames with a pose."""

    _frames: list[_Hung] = field(default_factory=list)

    def add(self, timestamp: float, T_world_rig: Array, keyframe: Keyframe) -> None:
        """Hang the pose of a frame on a keyframe."""
        T = se3.inverse(keyframe.T_world_rig) @ T_world_rig
        self._frames.append(_Hung(timestamp, keyframe, T, keyframe.scale))

    def rehang(self, keyframe: Keyframe) -> None:
        """Let the frame that has become a keyframe follow itself."""
        for i in range(len(self._frames) - 1, -1, -1):
            if self._frames[i].timestamp == keyframe.timestamp:
                self._frames[i] = _Hung(keyframe.timestamp, keyframe, np.eye(4), keyframe.scale)
                return

    def velocity(self, timestamp: float) -> Array:
        """Right-hand twist (6,) a second at a recent frame, from its neighbours in time; zero without any."""
        near = [f for f in self._frames[-_RECENT:] if abs(f.timestamp - timestamp) < _NEAR]
        if len(near) < 2:
            return np.zeros(6)
        near.sort(key=lambda f: f.timestamp)
        at = bisect_left(near, timestamp, key=lambda f: f.timestamp)
        a, b = near[max(at - 1, 0)], near[min(at + 1, len(near) - 1)]
        T_a_b = se3.inverse(a.T_world_rig()) @ b.T_world_rig()
        return np.asarray(se3.log(T_a_b) / (b.timestamp - a.timestamp))

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
