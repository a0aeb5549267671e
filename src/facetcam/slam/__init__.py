"""Visual SLAM through mirrors."""

from facetcam.slam.config import SlamConfig
from facetcam.slam.state import State, Status, ViewHealth
from facetcam.slam.system import Slam

__all__ = ["Slam", "SlamConfig", "State", "Status", "ViewHealth"]
