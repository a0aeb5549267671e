"""`python -m facetcam`."""

from facetcam.cli import main

main()
