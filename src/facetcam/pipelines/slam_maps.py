"""The map file of a run: loaded before it, kept up to date while it goes on, written at its end."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from facetcam.errors import MapError
from facetcam.slam import Slam

FILE = "map.facetmap"

_EVERY = 10.0  # seconds between checkpoints
_SHARE = 0.02  # of the time, at most, that they may cost


@dataclass(frozen=True, slots=True)
class MapChoice:
    """What the user wants of maps: `path` to extend, or with `localize` only to look in; None: a new one."""

    path: Path | None = None
    localize: bool = False

    def check(self) -> None:
        """Raise MapError before any work if the map to look in is absent, or its folder is."""
        if self.path is None:
            if self.localize:
                raise MapError("localising needs a map; give --map")
        elif self.localize and not self.path.exists():
            raise MapError(f"{self.path}: no such map; make one by `facetcam slam FILM --rig RIG --map MAP`")
        elif not self.path.parent.is_dir():
            raise MapError(f"{self.path.parent}: no such folder, the map could not be written; make it")

    def load_into(self, slam: Slam) -> None:
        """Go on in the map where there is one."""
        if self.path is not None and self.path.exists():
            slam.load_map(self.path, localise_only=self.localize)


NEW_MAP = MapChoice()


class MapKeeper:
    """Writes the map of a run now and then, so that a killed run loses little.

    Parameters
    ----------
    slam : Slam
    choice : MapChoice
    folder : Path
        Of the run; a map without a place of its own is kept there.
    """

    def __init__(self, slam: Slam, choice: MapChoice, folder: Path) -> None:
        self._slam = slam
        self._folder = folder
        self.path = None if choice.localize else choice.path or folder / FILE
        self._due = time.monotonic() + _EVERY

    def after_frame(self) -> None:
        """Write a checkpoint where one is due."""
        if time.monotonic() >= self._due:
            start = time.monotonic()
            self.save()
            cost = time.monotonic() - start
            self._due = time.monotonic() + max(_EVERY, cost / _SHARE)

    def save(self) -> bool:
        """Write the map if this run added to it; raises OutputError where it cannot."""
        if self.path is None or not self._slam.grown:
            return False
        self._slam.save_map(self.path)
        return True

    def save_apart(self) -> None:
        """Write the maps that never met that one into the folder of the run."""
        for number in self._slam.trajectories_apart():
            self._slam.save_map(self._folder / f"map{number}.facetmap", number)
