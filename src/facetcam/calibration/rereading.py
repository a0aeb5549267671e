"""Parts of plain chessboards, which carry no names: read anew once the rig is roughly known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.evidence import TIGHT
from facetcam.calibration.fit import Fit, looks_of
from facetcam.calibration.readings import readings_of
from facetcam.calibration.rejection import error_in_view
from facetcam.calibration.sightings import Sighting

_LOSS = 10.0  # pixels


def reread(fit: Fit, boards: BoardSet, sightings: Sequence[Sighting]) -> Fit:
    """Name corners of plain chessboards as fits best now, and solve: parts are easily read squares astray.

    Parameters
    ----------
    sightings : sequence of Sighting
        As they were found, in any reading.
    """
    if all(board.kind != "chessboard" for board in boards.boards):
        return fit
    found = {id(s.pixels): s for s in sightings}
    named, tight = list(fit.sightings), fit.solved(TIGHT)
    for i, (s, place, station) in enumerate(zip(named, fit.looks.board, fit.looks.station)):
        ways = readings_of(found.get(id(s.pixels), s), boards)
        reads = [replace(way, view=s.view) for way in ways if way.mirrored in (None, s.mirrored)]
        if len(reads) > 1:
            named[i] = min(reads, key=lambda way: error_in_view(tight, boards, way, place, station))
    looks = looks_of(named, boards, fit.views, fit.looks.board, fit.looks.station)
    return replace(fit, sightings=tuple(named), looks=looks).solved(_LOSS)
