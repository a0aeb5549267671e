"""Calibration of a mirror rig from photos of boards."""

from facetcam.calibration.boards import Board, BoardSet, read_boards, write_boards
from facetcam.calibration.detection import detect
from facetcam.calibration.sightings import Sighting

__all__ = ["Board", "BoardSet", "Sighting", "detect", "read_boards", "write_boards"]
