"""Speed and memory of the simulator: 1600x1200 frames of a furnished house through the mirrors.

python benchmarks/simulate.py [--frames 8] [--samples 2] [--without-embree]
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time

from _common import data_folder, show

from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.simulation import embree
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.scene import Lamp
from facetcam.simulation.scene_files import read_scene
from facetcam.simulation.settings import CameraSettings

LAMPS = tuple(Lamp((x, y, 2.2), 1.5) for x, y in ((-6, 1), (-1, 1), (3, 1), (6, -3), (6, 3), (-6, -3)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--without-embree", action="store_true", help="trace by the tree in the core")
    options = parser.parse_args()
    if options.without_embree:
        embree.installed = lambda: False
    house = data_folder() / "house"
    begin = time.perf_counter()
    mesh = read_scene(house / "small_house.glb").mesh
    read = time.perf_counter() - begin
    begin, cpu = time.perf_counter(), time.process_time()
    renderer = MeshRenderer(mesh, LAMPS, (0.25,) * 3)
    baked, baked_cpu = time.perf_counter() - begin, time.process_time() - cpu
    rig = Rig.load(house / "rig_true.yaml")
    _, poses = read_tum(house / "loop.tum")
    exposures = Exposures(rig, renderer, CameraSettings(samples=options.samples))
    walls, cpus = [], []
    for pose in poses[:: max(1, len(poses) // options.frames)][: options.frames + 1]:
        begin, cpu = time.perf_counter(), time.process_time()
        exposures.radiance(lambda moment, pose=pose: pose, 0.0)
        walls.append(time.perf_counter() - begin)
        cpus.append(time.process_time() - cpu)
    wall, busy = statistics.median(walls[1:]), statistics.median(cpus[1:])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    width, height = rig.size
    rows = [
        ["scene read", f"{read:.1f}", ""],
        [f"light of {len(LAMPS)} lamps, once", f"{baked:.1f}", f"{baked_cpu:.1f}"],
        ["first frame, with the paths of its rays", f"{walls[0]:.2f}", f"{cpus[0]:.2f}"],
        [f"frame, median of {len(walls) - 1}", f"{wall:.2f}", f"{busy:.2f}"],
    ]
    title = f"{width}x{height}, {options.samples} rays a pixel, {len(mesh.faces)} triangles, {peak:.0f} MB"
    show(title, ["", "s", "s of processors"], rows)


if __name__ == "__main__":
    main()
