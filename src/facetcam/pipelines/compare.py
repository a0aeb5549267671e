"""From two trajectory files to tables and plots of their difference."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from pathlib import Path

import numpy as np

from facetcam.evaluation import trajectory as evaluation
from facetcam.io.outputs import atomic_write, fresh_folder, require_absent
from facetcam.io.trajectories import read_tum
from facetcam.pipelines.summary import to_json
from facetcam.viz import figures

Trajectory = evaluation.Trajectory


def run_compare(
    estimate: Path | str,
    truth: Path | str,
    out: Path | str | None = None,
    *,
    max_gap: float = 0.02,
    step: int = 1,
) -> dict[str, str]:
    """Compare an estimated trajectory with the true one.

    Parameters
    ----------
    estimate, truth : path
        TUM files.
    out : path, optional
        Folder to make for `errors.txt`, `errors.csv`, `errors.json`, `path.svg` and `errors.svg`.
    max_gap, step
        See `facetcam.evaluation.trajectory.evaluate`.

    Returns
    -------
    The tables by format: text, csv, json.

    Raises
    ------
    FacetcamError
        If a file cannot be read or written, or the two have too few times in common.
    """
    if out is not None:
        require_absent(out)
    own, true = read_tum(estimate), read_tum(truth)
    errors = evaluation.evaluate(own, true, max_gap, step)
    tables = {"text": as_text(errors), "csv": as_csv(errors), "json": to_json(errors)}
    if out is not None:
        folder = fresh_folder(out)
        for form, name in {"text": "errors.txt", "csv": "errors.csv", "json": "errors.json"}.items():
            atomic_write(folder / name, tables[form])
        for name, drawing in plots(own, true, max_gap).items():
            atomic_write(folder / name, figures.standalone(drawing))
    return tables


def as_text(errors: evaluation.TrajectoryErrors) -> str:
    """The errors as an aligned table."""
    degrees = evaluation.Errors(*(math.degrees(v) for v in dataclasses.astuple(errors.rpe_rotation)))
    rows = {
        "ATE, rigid alignment (m)": errors.ate,
        "ATE, scale aligned too (m)": errors.ate_scaled,
        "RPE, translation (m)": errors.rpe_translation,
        "RPE, rotation (deg)": degrees,
    }
    lines = [f"{'':28}{'rmse':>10}{'median':>10}{'mean':>10}{'max':>10}"]
    for name, row in rows.items():
        lines.append(f"{name:28}{row.rmse:10.4f}{row.median:10.4f}{row.mean:10.4f}{row.max:10.4f}")
    lines.append(f"scale error {100 * errors.scale_error:+.3f} %, true path {errors.true_length:.3f} m")
    lines.append(f"{errors.matched} of {errors.estimated} estimated poses have a true one")
    return "\n".join(lines) + "\n"


def as_csv(errors: evaluation.TrajectoryErrors) -> str:
    """The errors as lines `quantity,value`; metres and radians."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["quantity", "value"])
    for name, value in dataclasses.asdict(errors).items():
        parts = value.items() if isinstance(value, dict) else [("", value)]
        writer.writerows([f"{name}.{part}" if part else name, number] for part, number in parts)
    return text.getvalue()


def plots(estimate: Trajectory, truth: Trajectory, max_gap: float) -> dict[str, str]:
    """The two paths from above and their distance over time, after rigid alignment, as SVG by file name."""
    own, true = evaluation.associate(estimate[0], truth[0], max_gap)
    positions, target = estimate[1][own][:, :3, 3], truth[1][true][:, :3, 3]
    aligned = evaluation.align(positions, target, with_scale=False).apply(positions)
    nothing = np.empty((0, 3))
    return {
        "path.svg": figures.path_figure(estimate[0][own], aligned, nothing, nothing, target),
        "errors.svg": figures.error_figure(estimate[0][own], np.linalg.norm(aligned - target, axis=1)),
    }
