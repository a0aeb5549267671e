"""The search for the best rig from the preset `ryu`, on each goal: score, and what the rig found has.

python benchmarks/design_search.py [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from _common import show

from facetcam.design.search import Qualities, search
from facetcam.design.spec import DesignSpec, read_spec
from facetcam.pipelines.design import parse_goal

LENS = (600.0, 2500.0)  # focal lengths in pixels, where the lens is free
GOALS = (
    ("coverage", None),
    ("resolution", LENS),
    ("baseline", None),
    ("coverage=1,baseline=0.5", None),
    ("coverage=1,resolution=0.5", LENS),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    seed = parser.parse_args().seed
    spec, rows = read_spec("preset:ryu"), []
    for goal, lens in GOALS:
        begin = time.process_time()
        found = search(wishing(spec, goal, lens), seed)
        spent = time.process_time() - begin
        assert found.start is not None
        for words, q in (("ryu", found.start), ("found", found.best)):
            score = q.score(found.spec.search.goal)
            focal = spec.camera.focal if words == "ryu" else found.spec.camera.focal
            rows.append(
                [f"{goal}: {words}" if words == "ryu" else words, f"{score:.3f}", *told(q), f"{focal:.0f}"]
            )
        rows[-1] += [str(found.evaluations), f"{spent:.0f}"]
        rows[-2] += ["", ""]
    columns = ["goal", "score", "coverage", "px/degree", "baseline", "overlap", "f", "tried", "s"]
    show("search from `ryu` in 180 x 135 x 125 mm", columns, rows)


def wishing(spec: DesignSpec, goal: str, lens: tuple[float, float] | None) -> DesignSpec:
    bounds = replace(spec.search.bounds, focal=lens)
    return replace(spec, search=replace(spec.search, goal=parse_goal(goal), bounds=bounds))


def told(q: Qualities) -> list[str]:
    coverage, overlap = (f"{100 * share:.1f} %" for share in (q.coverage, q.overlap))
    return [coverage, f"{q.resolution:.1f}", f"{1e3 * q.baseline:.0f} mm", overlap]


if __name__ == "__main__":
    main()
