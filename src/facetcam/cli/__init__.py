"""The command line: one thin command a file."""

from facetcam.cli.app import main

__all__ = ["main"]
