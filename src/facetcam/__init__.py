"""Room-wide vision from one camera and a few flat mirrors."""

__version__ = "0.1.0"
