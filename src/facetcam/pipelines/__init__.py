"""Whole jobs, from files to files: what the command line and the examples call."""

from facetcam.pipelines.demo import Demo, run_demo
from facetcam.pipelines.design import Design, run_design
from facetcam.pipelines.detect import run_detect
from facetcam.pipelines.progress import Progress
from facetcam.pipelines.simulate import Simulated, run_simulate
from facetcam.pipelines.slam import run_slam
from facetcam.pipelines.summary import Summary
from facetcam.pipelines.unwrap import run_unwrap

__all__ = [
    "Demo",
    "Design",
    "Progress",
    "Simulated",
    "Summary",
    "run_demo",
    "run_design",
    "run_detect",
    "run_simulate",
    "run_slam",
    "run_unwrap",
]
