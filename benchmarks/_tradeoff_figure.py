"""The picture of `detectors_tradeoffs.py`: one panel for each bar that is missed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OURS, PALE, BAR = "#1f6feb", "#b9c2cc", "#e5484d"
OTHERS = ("#1aa179", "#e8890c", "#8a5cd0", "#8a6d3b", "#0f8b8d", "#c2418b")

Curves = Mapping[str, Sequence[tuple[float, float]]]


def draw(
    default: Any,
    others: Sequence[Any],
    gains: Curves,
    numbers: Curves,
    times: Mapping[str, tuple[float, float]],
    out: Path,
) -> None:
    """Four panels into one SVG; settings have `scores`, curves are points (x, y) by name."""
    figure = Figure(figsize=(9.6, 8.4), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    draw_settings(panels[0], default, others)
    draw_curves(
        panels[1], gains, "gain on the second image, clipped at 255", "repeatability over that without"
    )
    panels[1].axhline(0.9, color=BAR, lw=0.9, ls="--")
    panels[1].set_title("Light that clips (leuven)")
    draw_curves(panels[2], numbers, "points of each image", "MMA@3")
    panels[2].set_title("Matching under JPEG (ubc)")
    draw_times(panels[3], times)
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, metadata={"Date": None})


def draw_settings(axes: Axes, default: Any, others: Sequence[Any]) -> None:
    """Ubc against leuven; settings that lose the half shadow are pale, the bars dashed."""
    for kept, colour, label in ((False, PALE, "half shadow under .84"), (True, OURS, "half shadow at .84")):
        chosen = [s.scores for s in others if (s.scores["half shadow"] >= 0.84) == kept]
        places = ([s["leuven"] for s in chosen], [s["ubc"] for s in chosen])
        axes.plot(*places, "o", ms=3.5, color=colour, alpha=0.8, mew=0, label=label)
    own = default.scores
    axes.plot(own["leuven"], own["ubc"], "*", ms=15, color="#e8890c", mec="black", mew=0.7, label="default")
    axes.axvline(0.83, color=BAR, lw=0.9, ls="--")
    axes.axhline(0.80, color=BAR, lw=0.9, ls="--", label="bars")
    axes.set(xlabel="leuven (light)", ylabel="ubc (JPEG)", title="Settings of SIICF, protocol B")
    axes.set_ylim(bottom=0.62)
    finish(axes)
    axes.legend(fontsize=8, frameon=False, loc="lower left", markerscale=0.7)


def draw_curves(axes: Axes, curves: Curves, across: str, up: str) -> None:
    """One line a name, ours first and strong."""
    for index, (name, curve) in enumerate(curves.items()):
        colour = OURS if name.startswith("SIICF") else OTHERS[index % len(OTHERS)]
        style = {"lw": 2.2 if index == 0 else 1.3, "ls": ":" if "," in name else "-", "ms": 4}
        axes.plot(*zip(*curve, strict=True), marker="o", color=colour, label=name, **style)
    axes.set(xlabel=across, ylabel=up)
    finish(axes)


def draw_times(axes: Axes, times: Mapping[str, tuple[float, float]]) -> None:
    """Repeatability against time, each named at its mark; dashed is half of ORB's time."""
    for name, (ms, score) in times.items():
        axes.plot(ms, score, "o", ms=5, color=OURS if name.startswith("SIICF") else OTHERS[0])
        if not name.startswith("SIICF"):
            axes.annotate(name, (ms, score), (5, -11), textcoords="offset points", fontsize=8)
    ours = [place for name, place in times.items() if name.startswith("SIICF")]
    axes.plot(*zip(*ours, strict=True), color=OURS, lw=1.5)
    axes.annotate("SIICF, 1 to 4 scales", ours[-1], (9, -3), textcoords="offset points", fontsize=8)
    axes.axvline(times["ORB"][0] / 2, color=BAR, lw=0.9, ls="--", label="half of ORB's time")
    axes.axvline(times["ORB, FAST 5"][0] / 2, color=BAR, lw=0.9, ls=":", label="half of ORB's with FAST 5")
    axes.set(
        xscale="log",
        xlim=(2.3, 700),
        xlabel="ms for 1600x1200 (film), one thread",
        ylabel="protocol B, mean of four",
    )
    axes.set_title("Time and repeatability")
    finish(axes)


def finish(axes: Axes) -> None:
    axes.grid(color="#e3e6ea", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False)
