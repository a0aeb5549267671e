"""What the photos cannot tell, in words, and which photos would."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.covariance import Knowledge
from facetcam.calibration.fit import Fit, gauge_mirror
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.result import Unknown
from facetcam.calibration.uncertainty import aligned_slopes

Array = NDArray[np.float64]

_TOUCHED = 0.1  # share of a group in the open directions from which it is named
_LINKED = 0.05  # the same for two groups that are open only together
_SMALL = 10.0  # noises of a corner: by less, an open direction moves no view against another
_HARMLESS = 0.02  # of the movement that a direction causes, what remains after aligning rig frames


def unknowns(fit: Fit, known: Knowledge, boards: BoardSet) -> tuple[Unknown, ...]:
    """Everything that the photos leave open, the worst first."""
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    found = [_unseen(fit, view) for view in fit.nominal.views if view not in fit.views]
    found += _idle(fit)
    found += [_of_cluster(fit, known, names) for names in _clusters(known)]
    found += _gauge(optics) + _loose_boards(fit, boards)
    return tuple(sorted(found, key=lambda u: u.harmless))


def _unseen(fit: Fit, view: str) -> Unknown:
    mirrors = tuple(
        m
        for m in fit.nominal.views[view].mirrors
        if not any(m in fit.nominal.views[v].mirrors for v in fit.views)
    )
    said = f"; {_listed(mirrors, 'mirror')} stays as drawn" if mirrors else ""
    return Unknown(
        f"no photo shows a board in view '{view}'{said}",
        f"add photos with a board in view '{view}' and another board in a second view at once",
        mirrors,
    )


def _idle(fit: Fit) -> list[Unknown]:
    """Mirrors that no view of the rig uses."""
    used = {m for view in fit.nominal.views.values() for m in view.mirrors}
    return [
        Unknown(f"mirror '{name}' is in no view of the rig; it stays as drawn", mirrors=(name,))
        for name in fit.nominal.mirrors
        if name not in used
    ]


def _gauge(optics: MirrorOptics) -> list[Unknown]:
    """The mirror that everything is seen through."""
    gauge = gauge_mirror(optics)
    if gauge is None:
        return []
    name = optics.names[gauge]
    return [
        Unknown(
            f"mirror '{name}' follows from the drawing only: everything is seen through it, so that moving it"
            " with all that lies behind changes no photo",
            mirrors=(name,),
            harmless=True,
        )
    ]


def _loose_boards(fit: Fit, boards: BoardSet) -> list[Unknown]:
    if fit.places == (-1,):
        return []
    seen = [b for b in np.unique(fit.looks.board) if b < len(boards.boards)]  # not those that moved
    sets = [[boards.boards[b].name for b in seen if fit.part[b] == p] for p in np.unique(fit.part[seen])]
    if len(sets) < 2:
        return []
    text = " from ".join(_listed(names, "board") for names in sets)
    advice = "add a photo that shows boards of both sets"
    return [
        Unknown(f"how {text} stand apart is unknown: no photo shows them together", advice, harmless=True)
    ]


def _clusters(known: Knowledge) -> list[list[str]]:
    """Groups of numbers (mirrors, focal length, ...) that open directions touch, together or apart."""
    groups = _groups(known)
    projector = known.open_directions @ known.open_directions.T
    touched = [g for g, rows in groups.items() if np.trace(projector[np.ix_(rows, rows)]) > _TOUCHED]
    clusters: list[list[str]] = []
    for group in touched:
        linked = [
            c
            for c in clusters
            if any(np.linalg.norm(projector[np.ix_(groups[group], groups[o])]) > _LINKED for o in c)
        ]
        clusters = [c for c in clusters if c not in linked] + [[g for c in linked for g in c] + [group]]
    return clusters


def _groups(known: Knowledge) -> dict[str, list[int]]:
    """Rows of the information by what they belong to."""
    groups: dict[str, list[int]] = {}
    for row, index in enumerate(known.free):
        name = known.names[index]
        if ":" in name:
            group = f"mirror {name.split(':')[0]}"
        else:
            group = {"f": "focal length", "c": "principal point"}.get(name[0], "distortion")
        groups.setdefault(group, []).append(row)
    return groups


def _of_cluster(fit: Fit, known: Knowledge, names: Sequence[str]) -> Unknown:
    mirrors = tuple(n.removeprefix("mirror ") for n in names if n.startswith("mirror "))
    others = [n for n in names if not n.startswith("mirror ")]
    groups = _groups(known)
    rows = [r for n in names for r in groups[n]]
    if mirrors and not others and _is_harmless(fit, known, rows):
        return Unknown(
            f"{_listed(mirrors, 'mirror')} can be known against each other only: turning them together moves"
            " no view against another; the rest follows from the drawing",
            mirrors=mirrors,
            harmless=True,
        )
    if mirrors:
        return _of_mirrors(fit, mirrors, others)
    if "distortion" in others and "focal length" not in others:
        return Unknown(
            f"{_joined(others)}: the boards cover too little of the image",
            "add photos with boards close to the corners of the image",
        )
    return Unknown(
        f"{_joined(others)} cannot be told from the distances of the boards",
        "add photos with boards close to the rig and tilted by 30 to 50 degrees, in several directions",
    )


def _of_mirrors(fit: Fit, mirrors: tuple[str, ...], others: Sequence[str]) -> Unknown:
    alone = [v for v in fit.views if set(fit.nominal.views[v].mirrors) & set(mirrors) and not _shared(fit, v)]
    what = _listed(mirrors, "mirror")
    if alone:
        views = _listed(alone, "view")
        loose = fit.places == (-1,)
        advice = f"show {_pair(loose)}, one in {views} and one in another view"
        if loose and len({s.board for s in fit.sightings}) > 1:
            advice += "; or fix the boards to each other, which 'fixed: true' in boards.yaml tells"
        seen = "is" if len(alone) == 1 else "are"
        return Unknown(f"{what} cannot be known: {views} {seen} seen only alone", advice, mirrors)
    beside = f" (with {_joined(others)})" if others else ""
    return Unknown(
        f"{what}{beside} cannot be known: the photos tie {'its' if len(mirrors) == 1 else 'their'} views to"
        " the others too weakly",
        f"add photos with boards in the views of {what} and in others at once, near, over all of each view",
        mirrors,
    )


def _pair(loose: bool) -> str:
    return "the same board in two views" if loose else "two boards at once"


def _shared(fit: Fit, view: str) -> bool:
    """Tell whether some station shows boards in this view and in another."""
    looks = fit.looks.only(fit.kept)
    index = fit.views.index(view)
    used = np.unique(looks.sighting)
    here = set(looks.station[used[looks.view[used] == index]].tolist())
    return bool(here & set(looks.station[used[looks.view[used] != index]].tolist()))


def _is_harmless(fit: Fit, known: Knowledge, rows: Sequence[int]) -> bool:
    """Tell whether the open directions of some numbers move no view against another."""
    inside = np.zeros(len(known.free), dtype=bool)
    inside[list(rows)] = True
    steps = known.open_steps[:, np.linalg.norm(known.open_directions[inside], axis=0) > 0.5]
    raw, aligned = (np.sqrt(np.mean((slopes @ steps) ** 2)) for slopes in aligned_slopes(fit, known))
    return bool(aligned < max(_HARMLESS * raw, _SMALL * known.noise))


def _listed(names: Sequence[str], what: str) -> str:
    return f"{what}{'s' if len(names) > 1 else ''} {_joined([repr(n) for n in names])}"


def _joined(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
