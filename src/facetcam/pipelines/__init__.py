"""Whole jobs, from files to files: what the command line and the examples call."""

from facetcam.pipelines.detect import run_detect
from facetcam.pipelines.progress import Progress
from facetcam.pipelines.slam import run_slam
from facetcam.pipelines.summary import Summary
from facetcam.pipelines.unwrap import run_unwrap

__all__ = ["Progress", "Summary", "run_detect", "run_slam", "run_unwrap"]
