"""The rig model: camera, mirrors, views, their files and presets."""

from facetcam.rig.camera import Camera
from facetcam.rig.covariance import RigCovariance
from facetcam.rig.mirrors import Glass, Mirror
from facetcam.rig.rig import Rig
from facetcam.rig.view import View
from facetcam.rig.visibility import NO_VIEW

__all__ = ["NO_VIEW", "Camera", "Glass", "Mirror", "Rig", "RigCovariance", "View"]
