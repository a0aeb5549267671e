"""Live cameras, and what all sources refuse."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest
from films import FakeCapture

from facetcam.errors import ConfigError, SourceError
from facetcam.io.live import LiveCamera
from facetcam.io.sources import open_source


class TestLive:
    def test_frames_until_it_is_unplugged(self, monkeypatch: pytest.MonkeyPatch) -> None:
        capture = FakeCapture(4)
        monkeypatch.setattr(cv2, "VideoCapture", lambda index: capture)
        camera = LiveCamera(0)
        frames: Iterator = iter(camera)
        times = [next(frames).timestamp for _ in range(3)]
        assert camera.size == (64, 48)
        assert times[0] == 0.0
        assert times == sorted(times)
        with pytest.raises(SourceError, match="unplugged"):
            next(frames)
        assert capture.released

    def test_no_such_camera(self) -> None:
        with pytest.raises(SourceError, match="camera 97: no such camera"):
            open_source("97")


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_frame_rate_is_positive(tmp_path: Path, fps: float) -> None:
    with pytest.raises(ConfigError, match="--fps"):
        open_source(tmp_path, fps)
