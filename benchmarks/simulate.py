"""Speed and memory of the simulator: 1600x1200 frames of a furnished house through the mirrors.

python benchmarks/simulate.py [--frames 8] [--samples 2] [--without-embree] [--peer]
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time

import numpy as np
from _common import data_folder, show
from numpy.typing import NDArray

from facetcam.io.trajectories import read_tum
from facetcam.rig import Rig
from facetcam.simulation import embree
from facetcam.simulation.exposures import ROWS, Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.meshes import Mesh
from facetcam.simulation.scene import Lamp
from facetcam.simulation.scene_files import read_scene
from facetcam.simulation.settings import CameraSettings

LAMPS = tuple(Lamp((x, y, 2.2), 1.5) for x, y in ((-6, 1), (-1, 1), (3, 1), (6, -3), (6, 3), (-6, -3)))


def peer(mesh: Mesh, exposures: Exposures, pose: NDArray[np.float64]) -> tuple[float, float]:
    """Seconds, and of processors, in which trimesh finds what the rays of a frame meet, without light."""
    import trimesh

    height, samples = exposures.height, exposures.settings.samples
    hops = [
        h for k in range(samples) for top in range(0, height, ROWS) for h in exposures._hops(top, k, True)
    ]
    tracer = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).ray
    tracer.intersects_first([[0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0]])  # builds its tree
    begin, cpu = time.perf_counter(), time.process_time()
    for hop in hops:
        starts, ways = hop.start @ pose[:3, :3].T + pose[:3, 3], hop.direction @ pose[:3, :3].T
        tracer.intersects_first(starts, ways)
    return time.perf_counter() - begin, time.process_time() - cpu


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--without-embree", action="store_true", help="trace by the tree in the core")
    parser.add_argument("--peer", action="store_true", help="first hits of the same rays by trimesh, too")
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
    if options.peer:
        wall, busy = peer(mesh, exposures, poses[len(poses) // 2])
        rows.append(["trimesh with Embree, first hits alone", f"{wall:.2f}", f"{busy:.2f}"])
    title = f"{width}x{height}, {options.samples} rays a pixel, {len(mesh.faces)} triangles, {peak:.0f} MB"
    show(title, ["", "s", "s of processors"], rows)


if __name__ == "__main__":
    main()
