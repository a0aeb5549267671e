"""Plain chessboards: every sighting of one in a photo, whole or in part, any way round.

Corners are linked to the next ones along their edges; the links make grids. Colours say where in the board a
grid may lie. A plain pattern that looks the same in a mirror cannot tell whether it was seen in one: its
sightings are labelled as if seen directly, and `placements` lists all other ways to read them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from facetcam.calibration.boards import Board
from facetcam.calibration.corners import refine
from facetcam.calibration.markers import homography, project
from facetcam.calibration.saddles import Saddles, find_saddles
from facetcam.calibration.sightings import Sighting

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAST = 3  # corners a side of a grid
_NEAREST = 12  # saddles among which the next one is looked for
_CONE = np.radians(20.0)  # between an edge and the way to the next corner
_UNEVEN = 1.6  # ratio of two links in line
_THIN = 0.6  # share of an outer line that is not of the board, at most
_STRAY = 0.2  # of a square, from a homography of the whole grid

_TURNS = [np.array(m) for m in ([[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]])]
_FLIP = np.array([[1, 0], [0, -1]])


def detect_chessboards(grey: NDArray[np.uint8], board: Board, index: int, photo: int) -> list[Sighting]:
    """Find a plain chessboard in a photo, as often as it is seen.

    Parameters
    ----------
    grey : (H, W) uint8 array
    board : Board
        Of the kind `chessboard`; its upper left square is black.
    index, photo : int
        Of the board and the photo.

    Returns
    -------
    list of Sighting
        The largest first. `mirrored` is None where the pattern cannot tell; grids that cover only a part of
        the board are placed where they fit first (see `placements`).
    """
    sightings = []
    for cells, pixels in find_grids(grey):
        inner = _within(cells, board)
        cells, pixels = cells[inner], pixels[inner]
        ways = _ways(cells, board) if len(cells) >= LEAST * LEAST else []
        if not ways:
            continue
        parities = {mirrored for mirrored, _ in ways}
        side = _side(cells, pixels)
        refined, good = refine(grey, pixels, side)
        if good.sum() < LEAST * LEAST:
            continue
        corners = ways[0][1][good]
        mirrored = ways[0][0] if len(parities) == 1 else None
        sightings.append(Sighting(photo, index, corners, refined[good], mirrored))
    return sorted(sightings, key=lambda s: -len(s))


def placements(sighting: Sighting, board: Board, mirrored: bool) -> list[Sighting]:
    """All ways to read a sighting of a plain chessboard as seen directly or in a mirror, by its colours."""
    columns = board.squares[0] - 1
    cells = np.column_stack([sighting.corners % columns, sighting.corners // columns])
    if sighting.mirrored:  # back to what the image shows
        cells = cells @ _FLIP + (1, 0)  # where the mirror has exchanged rising and falling
    return [
        replace(sighting, corners=corners, mirrored=mirrored)
        for parity, corners in _ways(cells, board)
        if parity == mirrored
    ]


def _ways(cells: Index, board: Board) -> list[tuple[bool, Index]]:
    """Rows of `board.points` for each way in which cells (N, 2) of an image fit the board: direct ones first.

    Cells count along two directions of the image of which the second is clockwise from the first; at those
    of even sum the image darkens when one turns clockwise past the first direction, as at the board's first.
    """
    limits = np.array(board.squares) - 1
    ways: list[tuple[bool, Index]] = []
    for mirrored in (False, True):
        for turn in _TURNS:
            laid = cells @ (_FLIP @ turn if mirrored else turn).T
            low = laid.min(axis=0)
            room = limits - (laid.max(axis=0) - low + 1)
            if room.min() < 0:
                continue
            for shift in np.ndindex(int(room[0]) + 1, int(room[1]) + 1):
                placed = laid - low + np.array(shift)
                if _same_colours(cells, placed, turn, mirrored):
                    ways.append((mirrored, placed[:, 0] + placed[:, 1] * int(limits[0])))
    return ways


def _same_colours(cells: Index, placed: Index, turn: Index, mirrored: bool) -> bool:
    """A quarter turn exchanges rising and falling edges; so does a mirror."""
    swapped = bool(turn[0, 0] == 0) != mirrored
    return bool((int(cells[0].sum()) + int(placed[0].sum()) + swapped) % 2 == 0)


def find_grids(grey: NDArray[np.uint8]) -> list[tuple[Index, Array]]:
    """Find all regular grids of corners: cells (N, 2), as `_ways` takes them, and pixels (N, 2) of each."""
    saddles = find_saddles(grey)
    links = _links(saddles)
    seen = np.zeros(len(saddles.pixels), dtype=bool)
    grids = []
    for start in range(len(seen)):
        if not seen[start]:
            cells, members = _grown(start, links, seen)
            kept = _regular(cells, saddles.pixels[members]) if len(members) >= LEAST * LEAST else None
            if kept is not None:
                grids.append((cells[kept], saddles.pixels[members][kept]))
    return grids


def _links(saddles: Saddles) -> Index:
    """Next corners (N, 4) along the rising edge, the falling one clockwise of it, and opposite; -1 for none.

    An edge that rises at one corner falls at the next, looked at from there. Links that are not mutual, or
    much longer than that to the other side, are dropped.
    """
    count = len(saddles.pixels)
    if count < LEAST * LEAST:
        return np.full((count, 4), -1)
    rising = saddles.rising
    falling = rising + (saddles.falling - rising) % np.pi  # clockwise of the rising one
    angles = np.column_stack([rising, falling, rising + np.pi, falling + np.pi])
    near = np.asarray(cKDTree(saddles.pixels).query(saddles.pixels, min(_NEAREST, count))[1])
    way = saddles.pixels[near] - saddles.pixels[:, None]
    length = np.linalg.norm(way, axis=2)
    heading = np.arctan2(way[..., 1], way[..., 0])
    links = np.full((count, 4), -1)
    reach = np.full((count, 4), np.inf)
    for edge in range(4):
        ahead = np.abs(_wrapped(heading - angles[:, edge, None])) < _CONE
        # Seen from the other corner, the edge back is of the other sort.
        back = _wrapped(heading + np.pi - angles[near, 1 - edge % 2])
        fits = ahead & (np.minimum(np.abs(back), np.pi - np.abs(back)) < _CONE) & (length > 0)
        distance = np.where(fits, length, np.inf)
        best = distance.argmin(axis=1)
        rows = np.arange(count)
        reach[:, edge] = distance[rows, best]
        links[:, edge] = np.where(np.isfinite(reach[:, edge]), near[rows, best], -1)
    reach[links < 0] = np.inf
    for edge in range(4):
        uneven = reach[:, edge] > _UNEVEN * np.minimum(reach[:, edge - 2], np.inf)
        links[uneven & (links[:, edge - 2] >= 0), edge] = -1
    mutual = np.array([[b >= 0 and bool((links[b] == a).any()) for b in links[a]] for a in range(count)])
    return np.where(mutual, links, -1)


def _grown(start: int, links: Index, seen: NDArray[np.bool_]) -> tuple[Index, Index]:
    """Cells and indices of all corners linked to one. Cells of even sum have their falling edge along x."""
    placed = {start: (0, 0)}
    frame = {start: 1}  # which of a corner's links is +x
    taken = {(0, 0)}
    queue = deque([start])
    steps = ((1, 0), (0, 1), (-1, 0), (0, -1))
    while queue:
        a = queue.popleft()
        for k, (dx, dy) in enumerate(steps):
            b = int(links[a, (frame[a] + k) % 4])
            if b < 0 or b in placed or seen[b]:
                continue
            cell = (placed[a][0] + dx, placed[a][1] + dy)
            if cell in taken:
                continue
            back = int(np.flatnonzero(links[b] == a)[0])
            placed[b], frame[b] = cell, (back + 2 - k) % 4
            taken.add(cell)
            queue.append(b)
    members = np.array(list(placed))
    seen[members] = True
    return np.array(list(placed.values())), members


def _within(cells: Index, board: Board) -> NDArray[np.bool_]:
    """Mask of the cells after outer lines with few corners are dropped, until the grid fits on the board.

    Corners of a board's rim against what lies behind it may look like one line more.
    """
    kept = np.ones(len(cells), dtype=bool)
    limits = sorted(n - 1 for n in board.squares)
    while kept.sum() >= LEAST * LEAST:
        inside = cells[kept]
        low, high = inside.min(axis=0), inside.max(axis=0)
        outer = [(int((inside[:, a] == end[a]).sum()), a, int(end[a])) for a in (0, 1) for end in (low, high)]
        count, axis, line = min(outer)
        if count >= LEAST and np.all(np.sort(high - low + 1) <= limits):
            break
        if count > _THIN * (high - low + 1)[1 - axis]:  # a line of a larger board
            return np.zeros(len(cells), dtype=bool)
        kept &= cells[:, axis] != line
    return kept


def _regular(cells: Index, pixels: Array) -> NDArray[np.bool_] | None:
    """Mask of the corners that a homography of the grid explains; None where that is no grid."""
    kept = np.ones(len(cells), dtype=bool)
    for _ in range(3):
        if kept.sum() < LEAST * LEAST or np.ptp(cells[kept], axis=0).min() < LEAST - 1:
            return None
        H = homography(cells[kept].astype(np.float64), pixels[kept])
        if H is None:
            return None
        off = np.linalg.norm(project(H, cells.astype(np.float64)) - pixels, axis=1)
        kept = off < _STRAY * _side(cells, pixels)
    sparse = kept.sum() < 0.6 * np.prod(np.ptp(cells[kept], axis=0) + 1) if kept.any() else True
    return None if sparse or kept.sum() < LEAST * LEAST else kept


def _side(cells: Index, pixels: Array) -> Array:
    """Shortest distance (N,) from each corner to those beside it in the grid, in pixels."""
    apart = np.abs(cells[:, None] - cells[None]).sum(axis=2)
    distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    beside = np.where(apart == 1, distance, np.inf).min(axis=1)
    typical = np.median(beside[np.isfinite(beside)]) if np.isfinite(beside).any() else 1.0
    return np.where(np.isfinite(beside), beside, typical)


def _wrapped(angle: Array) -> Array:
    wrapped: Array = (angle + np.pi) % (2 * np.pi) - np.pi
    return wrapped
