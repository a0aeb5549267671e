"""Calibration of a mirror rig from photos of boards."""

from facetcam.calibration.board_files import read_boards, write_boards
from facetcam.calibration.boards import Board, BoardSet
from facetcam.calibration.detection import detect
from facetcam.calibration.sightings import Sighting

__all__ = ["Board", "BoardSet", "Sighting", "detect", "read_boards", "write_boards"]
