"""Raw frame to undistorted, upright, un-mirrored views and panoramas."""

from facetcam.unwrapping.panorama import Panorama
from facetcam.unwrapping.unwrapper import Unwrapper, unwrap
from facetcam.unwrapping.views import VirtualView, write_views

__all__ = ["Panorama", "Unwrapper", "VirtualView", "unwrap", "write_views"]
