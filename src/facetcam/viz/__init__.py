"""What a run looks like: self-contained HTML reports."""

from __future__ import annotations

from facetcam.viz.pages import write_demo_report, write_slam_report, write_unwrap_report
from facetcam.viz.report import Check, DemoReport, Picture, SlamReport, Truth, UnwrapReport

__all__ = [
    "Check",
    "DemoReport",
    "Picture",
    "SlamReport",
    "Truth",
    "UnwrapReport",
    "write_demo_report",
    "write_slam_report",
    "write_unwrap_report",
]
