"""Native kernels of facetcam."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

def detect_corners(
    image: NDArray[Any],
    mask: NDArray[np.uint8] | None,
    table: NDArray[np.int16],
    scales: int,
    sigma: float,
    window: float,
    alpha: float,
    compression: float,
    coarse_weight: float,
    threshold: float,
    suppression: int,
    border: int,
    max_features: int,
    cell: int,
    oriented: bool,
    threads: int,
    isa: int = -1,
) -> NDArray[np.float32]: ...
def transfer_table(
    image: NDArray[Any], mask: NDArray[np.uint8] | None, eta: float, black: float | None = None
) -> NDArray[np.int16]: ...
def best_isa() -> int: ...
def hamming(query: NDArray[np.uint8], train: NDArray[np.uint8]) -> NDArray[np.int32]: ...
def match_mutual(
    query: NDArray[np.uint8],
    train: NDArray[np.uint8],
    group: NDArray[np.int32],
    groups: int,
    max_distance: int,
    ratio: float,
) -> NDArray[np.int32]: ...
def match_windowed(
    query: NDArray[np.uint8],
    query_xy: NDArray[np.float32],
    query_view: NDArray[np.int32],
    train: NDArray[np.uint8],
    train_xy: NDArray[np.float32],
    train_view: NDArray[np.int32],
    radius: float,
    max_distance: int,
    ratio: float,
) -> NDArray[np.int32]: ...
def trace_rays(
    planes: NDArray[np.float64],
    glass: NDArray[np.float64],
    bounds: NDArray[np.float64],
    starts: NDArray[np.int32],
    directions: NDArray[np.float64],
    bounces: int,
) -> tuple[NDArray[np.int8], NDArray[np.float64]]: ...

class Lens:
    def __init__(
        self,
        kannala_brandt: bool,
        size: tuple[float, float],
        intrinsics: tuple[float, float, float, float],
        radial: Sequence[float],
        tangential: Sequence[float],
        limit: float,
    ) -> None: ...
    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]: ...
    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]: ...

def remap(
    sources: NDArray[np.uint16],
    runs: NDArray[np.int32],
    image: NDArray[Any],
    output: NDArray[Any],
    threads: int,
) -> None: ...
def align_patches(
    full: NDArray[np.uint8],
    half: NDArray[np.uint8],
    patches: NDArray[np.uint8],
    offsets: NDArray[np.float32],
    warps: NDArray[np.float32],
    start: NDArray[np.float32],
    max_shift: float,
    max_iterations: int,
    threads: int,
    isa: int = -1,
) -> NDArray[np.float32]: ...
def self_similarity(
    patches: NDArray[np.uint8],
    offsets: NDArray[np.float32],
    radius: int,
    apart: float,
    threads: int,
) -> NDArray[np.float32]: ...
def adjust_bundle(
    focal: float,
    T_view_rig: NDArray[np.float64],
    T_world_rig: NDArray[np.float64],
    fixed: NDArray[np.bool_],
    points: NDArray[np.float64],
    frame: NDArray[np.int64],
    view: NDArray[np.int64],
    point: NDArray[np.int64],
    plane: NDArray[np.float64],
    edge: NDArray[np.float64],
    between: NDArray[np.int64],
    T_i_j: NDArray[np.float64],
    roots: NDArray[np.float64],
    motion_loss_scales: NDArray[np.float64],
    by_shared: NDArray[np.float64],
    shared: NDArray[np.float64],
    shared_weight: NDArray[np.float64],
    loss_scale: float,
    max_iterations: int,
    tolerance: float,
    threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float, float, int]: ...
def refine_pose(
    focal: float,
    T_view_rig: NDArray[np.float64],
    T_world_rig: NDArray[np.float64],
    points: NDArray[np.float64],
    view: NDArray[np.int64],
    plane: NDArray[np.float64],
    edge: NDArray[np.float64],
    sigma: float,
    max_steps: int,
) -> NDArray[np.float64]: ...

class TriangleShader:
    def __init__(
        self,
        triangles: NDArray[np.uint8],
        uv: NDArray[np.float32],
        materials: NDArray[np.uint8],
        texels: NDArray[np.uint8],
        tints: NDArray[np.uint8],
        places: int,
    ) -> None: ...
    def shade(
        self,
        light: NDArray[np.float32],
        directions: NDArray[np.float32],
        travelled: NDArray[np.float32],
        hits: NDArray[np.uint8],
        ray_angle: float,
        threads: int,
    ) -> NDArray[np.float32]: ...

class TriangleTree:
    def __init__(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> None: ...
    def cast(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], threads: int
    ) -> NDArray[np.uint8]: ...

def cast_by_embree(
    intersect: int,
    scene: int,
    origins: NDArray[np.float32],
    directions: NDArray[np.float32],
    threads: int,
) -> NDArray[np.uint8]: ...
