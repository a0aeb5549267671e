"""Mirror rigs on paper: what they see, how well they can be built, and which is the best."""

from facetcam.design.analysis import Analysis, analyse
from facetcam.design.areas import view_areas
from facetcam.design.family import build, make_rig
from facetcam.design.optimal import OptimalCamera, best_camera, longest_focal
from facetcam.design.search import Found, search
from facetcam.design.spec import DesignSpec, Family, read_spec
from facetcam.design.tolerance import ToleranceReport, simulate_builds

__all__ = [
    "Analysis",
    "DesignSpec",
    "Family",
    "Found",
    "OptimalCamera",
    "ToleranceReport",
    "analyse",
    "best_camera",
    "build",
    "longest_focal",
    "make_rig",
    "read_spec",
    "search",
    "simulate_builds",
    "view_areas",
]
