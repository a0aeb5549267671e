"""Calibration against truth: the rendered house, disturbed starts, fewer photos, honest sigmas."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from _common import data_folder, show

from facetcam.calibration.boards import BoardSet
from facetcam.calibration.covariance import knowledge
from facetcam.calibration.difference import projection_difference, room_points
from facetcam.calibration.fit import Fit
from facetcam.calibration.optics import MirrorOptics
from facetcam.calibration.rejection import spread_of
from facetcam.calibration.result import Calibration
from facetcam.calibration.sightings import Sighting
from facetcam.calibration.solve import solve
from facetcam.calibration.validation import validate
from facetcam.pipelines.calibrate import Seen, look
from facetcam.pipelines.photos import SecondLook
from facetcam.rig import Glass, Rig, presets

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from calibration_worlds import boards, disturbed, sightings_of

POINTS = 2000  # a view, 0.5 to 6 m away
NOISE = 0.1  # pixels, of projected corners


def house(data: Path) -> tuple[Seen, SecondLook, Rig]:
    """The 30 photos of the house, looked at once, and the true rig."""
    folder = data / "house"
    with tempfile.TemporaryDirectory() as cache:
        photos, set = folder / "calibration", folder / "calibration" / "boards.yaml"
        seen = look(photos, set, Path(cache) / "out", rig=folder / "rig_nominal.yaml", cache=cache)
    return seen, SecondLook(seen.photos), Rig.load(folder / "rig_true.yaml")


def whole(data: Path) -> None:
    """All photos, from the drawing."""
    began = time.perf_counter()
    seen, second, true = house(data)
    looked = time.perf_counter() - began
    assert seen.rig is not None
    result = solve(seen.rig, seen.boards, seen.sightings, second)
    judged = validate(result)
    points = room_points(true, list(true.views), POINTS)
    before = projection_difference(true, seen.rig, points)
    after = projection_difference(true, result.rig, points)
    focal = result.rig.camera.fx / true.camera.fx - 1.0
    rows = [
        ["RMS of the corners kept", f"{result.rms():.4f} px"],
        ["corners kept", f"{result.fit.kept.sum()} of {len(result.fit.kept)}"],
        ["held-out RMS", f"{judged.held_out_rms:.4f} px"],
        ["from one view to the others", f"{judged.cross_view_rms:.3f} px"],
        ["the same, as the sigmas foretell", f"{judged.cross_view_expected:.3f} px"],
        ["two halves against each other", f"{judged.split_half_rms:.4f} px"],
        [
            "sigma in the views, median",
            f"{np.nanmedian([np.nanmedian(m.sigma_px) for m in judged.maps]):.4f} px",
        ],
        ["off the truth as drawn", f"{before.rms:.3f} px"],
        ["off the truth as solved", f"{after.rms:.4f} px"],
        ["the worst view", f"{max(after.by_view.values()):.4f} px"],
        ["focal length off", f"{100 * focal:+.4f} %"],
        ["looking for boards", f"{looked:.1f} s"],
        ["solving", f"{result.seconds:.1f} s"],
    ]
    show("House, 30 photos, from the drawing", ("", "value"), rows)


def few(data: Path) -> None:
    """Ten photos, drawn at random twenty times."""
    seen, second, true = house(data)
    points = room_points(true, list(true.views), POINTS)
    random = np.random.default_rng(0)
    found = []
    assert seen.rig is not None
    for _ in range(20):
        chosen = set(random.choice(len(seen.photos), 10, replace=False).tolist())
        part = [s for s in seen.sightings if s.photo in chosen]
        found.append(projection_difference(true, solve(seen.rig, seen.boards, part, second).rig, points).rms)
    row = [f"{value:.4f}" for value in np.percentile(found, [0, 50, 100])]
    show("House, 10 of 30 photos, 20 draws: off the truth, px", ("", "best", "median", "worst"), [["", *row]])


def starts(data: Path) -> None:
    """Twenty starts, every mirror 3 degrees and 5 mm and the focal length 10 % off the drawing."""
    seen, second, true = house(data)
    assert seen.rig is not None
    points = room_points(true, list(true.views), POINTS)
    reference = solve(seen.rig, seen.boards, seen.sightings, second).rig
    rows = []
    for seed in range(20):
        result = solve(disturbed(seen.rig, 3.0, 0.005, 0.1, seed), seen.boards, seen.sightings, second)
        apart = projection_difference(reference, result.rig, points).rms
        off = projection_difference(true, result.rig, points).rms
        rows.append([str(seed), f"{apart:.5f}", f"{off:.4f}", f"{result.seconds:.1f}"])
    columns = ("start", "from the answer of the drawing, px", "off the truth, px", "s")
    show("House, disturbed starts", columns, rows)


def worlds() -> Iterator[tuple[str, Rig, BoardSet]]:
    """Rigs of other kinds with boards fixed round them."""
    distortion = (-0.1, 0.03, 2e-4, -3e-4, 0.0)
    for name, rig in (
        ("ryu", presets.ryu()),
        ("pyramid", presets.pyramid()),
        ("pyramid of 3", presets.pyramid(3)),
    ):
        yield name, replace(rig, camera=replace(rig.camera, distortion=distortion)), boards(8, True)
    rig = presets.table()
    table = replace(rig, camera=replace(rig.camera, distortion=distortion))
    yield "table", table, boards(1, False, 0.025, (8, 6))
    pane = Glass(0.004, 1.52, thickness_sigma=0.004)  # hardly more than that there is glass
    panes = {name: replace(mirror, glass=pane) for name, mirror in table.mirrors.items()}
    yield "table, glass", replace(table, mirrors=panes), boards(1, False, 0.025, (8, 6))


def sigma(trials: int, chosen: Sequence[str] = ()) -> None:
    """How often the truth lies within one and three sigma, over all numbers of lens, mirrors and glass."""
    rows = []
    for name, rig, set in worlds():
        if chosen and name not in chosen:
            continue
        normalised = np.concatenate(list(normalised_errors(rig, set, trials)))
        z = np.abs(normalised[np.isfinite(normalised)])
        shares = [f"{100 * np.mean(z < k):.1f} %" for k in (1, 2, 3)]
        rows.append([name, str(len(z)), *shares, f"{100 * np.mean(~np.isfinite(normalised)):.0f} %"])
    columns = ("rig", "numbers", "within 1 sigma", "2 sigma", "3 sigma", "said to be open")
    show(f"Honest sigmas: {trials} noise trials of {NOISE} px, 24 photos", columns, rows)


def normalised_errors(rig: Rig, set: BoardSet, trials: int) -> Iterator[np.ndarray]:
    """Errors over sigmas of each trial; the corners are the same, the noise is not."""
    clean = sightings_of(rig, set, 24, 0.0, 1)
    first = solve(rig, set, noisy(clean, 0))
    truth = true_values(first, rig)
    for trial in range(trials):
        told = restated(first.fit, trial)
        fit = refitted(told, noisy(list(first.fit.sightings), trial, clean))
        known = knowledge(fit, NOISE)
        yield (values(fit)[known.free] - truth[known.free]) / known.sigma


def noisy(seen: Sequence[Sighting], seed: int, exact: Sequence[Sighting] | None = None) -> list[Sighting]:
    """The same sightings with the noise of a seed on their exact pixels (default: their own)."""
    random = np.random.default_rng(1000 + seed)
    pixels = [s.pixels if exact is None else exact_pixels(s, exact) for s in seen]
    return [replace(s, pixels=p + NOISE * random.standard_normal(p.shape)) for s, p in zip(seen, pixels)]


def exact_pixels(sighting: Sighting, exact: Sequence[Sighting]) -> np.ndarray:
    """Pixels of the nearest sighting of the same corners: a photo may show them in several views."""
    same = [
        e.pixels
        for e in exact
        if (e.photo, e.board) == (sighting.photo, sighting.board)
        and np.array_equal(e.corners, sighting.corners)
    ]
    return min(same, key=lambda p: float(np.abs(p - sighting.pixels).max()))


def restated(fit: Fit, seed: int) -> Fit:
    """What is stated of the glass off the truth by its own sigma: it counts as a measurement too."""
    optics = fit.state.optics
    assert isinstance(optics, MirrorOptics)
    sigma = optics.tolerance[3 * len(optics.planes) :].reshape(-1, 2)
    drawn = optics.drawn + sigma * np.random.default_rng(2000 + seed).standard_normal(sigma.shape)
    return replace(fit, state=replace(fit.state, optics=replace(optics, drawn=drawn)))


def refitted(fit: Fit, sightings: Sequence[Sighting]) -> Fit:
    """The same problem solved for other pixels."""
    looks = replace(fit.looks, pixels=np.concatenate([s.pixels for s in sightings]))
    whole = replace(fit, sightings=tuple(sightings), looks=looks, kept=np.ones(len(looks.pixels), dtype=bool))
    whole = replace(whole, prior=replace(whole.prior, noise=NOISE)).solved(None)
    return replace(whole, looks=replace(looks, spread=spread_of(whole, NOISE))).solved(None)


def values(fit: Fit) -> np.ndarray:
    """Numbers of lens, mirrors and glass."""
    assert isinstance(fit.state.optics, MirrorOptics)
    return np.concatenate([fit.state.intrinsics, fit.state.optics.values])


def true_values(result: Calibration, rig: Rig) -> np.ndarray:
    """The true numbers: the drawing was the truth, so that no mirror has moved."""
    camera = rig.camera
    optics = result.fit.state.optics
    assert isinstance(optics, MirrorOptics)
    mirrors = np.concatenate([np.zeros(3 * len(optics.planes)), optics.drawn.reshape(-1)])
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion, *mirrors])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["whole", "few", "starts", "sigma"])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--rig", action="append", default=[], help="of the noise trials (default: all)")
    chosen = parser.parse_args()
    for part in chosen.parts:
        if part == "sigma":
            sigma(chosen.trials, chosen.rig)
        else:
            {"whole": whole, "few": few, "starts": starts}[part](data_folder())


if __name__ == "__main__":
    main()
