"""The simulator and the rig's projection against Mitsuba 3: real conductor mirrors, real path tracing."""

from __future__ import annotations

import os
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import erf
from simulated_rooms import FIELDS, glowing, resized, room_quads

from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.simulation.exposures import Exposures
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.settings import CameraSettings

pytestmark = pytest.mark.slow
Array = NDArray[np.float64]

POSE = se3.exp([0.03, -0.02, 0.25, 0.06, -0.08, 0.05])
SAMPLES = 36
UNIT = (
    1000.0  # Mitsuba lifts a reflected ray off its mirror by 2e-4 (1 + |x|): 0.2 mm in metres, 0.02 mm in mm
)
SEAM_MARGIN = 6  # pixels
FINEST = 0.05  # pixels; `cornerSubPix` itself is as far off on such edges


@pytest.fixture(scope="module")
def mitsuba() -> ModuleType:
    mi = pytest.importorskip("mitsuba", reason="pip install facetcam[reference]")
    found = sorted(Path("/usr/lib/x86_64-linux-gnu").glob("libLLVM*.so*19*")) + sorted(
        Path("/usr/lib/x86_64-linux-gnu").glob("libLLVM-19.so*")
    )
    if found:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(found[0]))
    mi.set_variant("llvm_ad_rgb" if os.environ.get("DRJIT_LIBLLVM_PATH") else "scalar_rgb")
    return mi


@pytest.fixture(scope="module", params=["preset:ryu", "preset:pyramid"])
def rig(request: pytest.FixtureRequest) -> Rig:
    """The folded rig, two reflections a view, and the direct pyramid, one."""
    return resized(Rig.load(request.param), 0.5)


@pytest.fixture(scope="module")
def reference(mitsuba: ModuleType, rig: Rig) -> NDArray[np.float32]:
    """Linear light (H, W, 3), traced by Mitsuba through mirrors of perfectly smooth metal."""
    mi, camera = mitsuba, rig.camera
    assert (camera.cx, camera.cy) == ((camera.width - 1) / 2, (camera.height - 1) / 2)
    assert camera.fx == camera.fy
    large = np.diag([UNIT, UNIT, UNIT, 1.0])
    turned = POSE @ rig.T_rig_cam @ np.diag([-1.0, -1.0, 1.0, 1.0])  # Mitsuba's x is left and its y up
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sensor": {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))),
            "fov_axis": "x",
            "near_clip": 0.01 * UNIT,  # a wide range of depths would cost its 32-bit projection digits
            "far_clip": 20.0 * UNIT,
            "to_world": mi.ScalarTransform4f(in_units(turned)),
            "film": {
                "type": "hdrfilm",
                "width": camera.width,
                "height": camera.height,
                "rfilter": {"type": "box"},
                "component_format": "float32",
            },
            "sampler": {"type": "multijitter", "sample_count": SAMPLES},
        },
    }
    for k, (corner, right, down, picture) in enumerate(room_quads()):
        light = np.square(picture[::-1].astype(np.float32) / 255)  # Mitsuba counts v from below
        normal = np.cross(down, right)
        matrix = np.eye(4)
        matrix[:3] = np.column_stack(
            [right / 2, -down / 2, normal / np.linalg.norm(normal), corner + right / 2 + down / 2]
        )
        texture = {"type": "bitmap", "bitmap": mi.Bitmap(light), "raw": True, "wrap_mode": "clamp"}
        scene[f"wall{k}"] = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(large @ matrix),
            "emitter": {"type": "area", "radiance": texture},
        }
    metal = {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}
    for name, mirror in rig.mirrors.items():
        assert mirror.polygon is not None
        scene[f"mirror-{name}"] = polygon(mi, se3.transform(POSE, mirror.polygon), metal)
    image = np.array(mi.render(mi.load_dict(scene), spp=SAMPLES))
    return np.ascontiguousarray(image[..., :3], dtype=np.float32)


def in_units(T: Array) -> Array:
    """A pose whose translation is in Mitsuba's unit."""
    moved = T.copy()
    moved[:3, 3] *= UNIT
    return moved


def polygon(mi: ModuleType, corners: Array, bsdf: dict) -> object:
    """A flat convex mesh of Mitsuba."""
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(bsdf)
    mesh = mi.Mesh("polygon", len(corners), len(corners) - 2, props=props)
    faces = np.array([[0, k, k + 1] for k in range(1, len(corners) - 1)], dtype=np.uint32)
    params = mi.traverse(mesh)
    params["vertex_positions"] = (UNIT * corners).astype(np.float32).ravel()
    params["faces"] = faces.ravel()
    params.update()
    return mesh


def eight_bit(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.rint(255 * np.sqrt(np.clip(light, 0, 1))).astype(np.uint8)


def board_corners() -> Array:
    """Inner corners of all walls in the rig frame."""
    grid = np.arange(1, FIELDS) / FIELDS
    u, v = (a.ravel()[:, None] for a in np.meshgrid(grid, grid))
    world = [corner + u * right + v * down for corner, right, down, _ in room_quads()]
    return se3.transform(se3.inverse(POSE), np.concatenate(world))


def crossing(grey: Array, start: Array, half: int = 7) -> Array:
    """Where two blurred straight edges cross: least squares over place, slants and widths of the edges."""
    x, y = np.rint(start).astype(int)
    patch = grey[y - half : y + half + 1, x - half : x + half + 1].ravel()
    across, along = (a.ravel() for a in np.meshgrid(*(np.arange(c - half, c + half + 1) for c in (x, y))))

    def misfit(q: Array) -> Array:
        dx, dy = across - q[0], along - q[1]
        one, other = (erf((np.cos(a) * dx + np.sin(a) * dy) / w) for a, w in (q[[2, 4]], q[[3, 5]]))
        fields = one * other
        # What the paper shows is uneven: every sum of these that fits best.
        levels = np.column_stack([np.ones(len(dx)), dx, dy, one, other, fields, fields * dx, fields * dy])
        return levels @ np.linalg.lstsq(levels, patch, rcond=None)[0] - patch

    slants = np.radians((0.0, 30.0, 60.0))
    fits = [least_squares(misfit, [*start, a, a + np.pi / 2, 1.0, 1.0]) for a in slants]
    return np.asarray(min(fits, key=lambda fit: fit.cost).x[:2])


def errors_of(found: Array, truth: Array, words: str) -> Array:
    distance = np.linalg.norm(found - truth, axis=1)
    rms = np.sqrt(np.mean(distance**2))
    print(f"{len(distance)} corners {words}, rms {rms:.4f} px, most {distance.max():.4f} px")
    return distance


def test_crossings_are_found_better_than_they_are_asked() -> None:
    # Slanted checkers of known place, with ramps as wide as the texels of the walls, two to three pixels;
    # each pixel is the mean of 16 x 16 places in it.
    rng, size, fine = np.random.default_rng(0), 25, 16
    places = (np.arange(size * fine) + 0.5) / fine - 0.5
    truth, found, plain = [], [], []
    for _ in range(30):
        centre = size // 2 + rng.uniform(-0.5, 0.5, 2)
        slants = rng.uniform(0, np.pi) + np.array([0.0, np.pi / 2 + rng.uniform(-0.3, 0.3)])
        x, y = np.meshgrid(places - centre[0], places - centre[1])
        across = [(np.cos(a) * x + np.sin(a) * y) / rng.uniform(2, 3) for a in slants]
        one, other = (np.clip(2 * a, -1, 1) for a in across)
        grey = np.rint((90 + 75 * one * other).reshape(size, fine, size, fine).mean(axis=(1, 3)))
        truth.append(centre)
        found.append(crossing(grey, centre + rng.uniform(-0.2, 0.2, 2)))
        plain.append(refined(grey.astype(np.uint8), centre[None])[0])
    assert errors_of(np.array(found), np.array(truth), "drawn").max() < 0.4 * FINEST
    errors_of(np.array(plain), np.array(truth), "drawn, by cornerSubPix")


def refined(grey: NDArray[np.uint8], start: Array) -> Array:
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    places = start.astype(np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, places, (4, 4), (-1, -1), criteria)[:, 0])


def test_checker_corners_in_the_mirrors_are_where_the_rig_projects_them(
    rig: Rig, reference: NDArray[np.float32]
) -> None:
    # In linear light, where a pixel on an edge is the mean of what it covers.
    grey = np.rint(255 * np.clip(reference.mean(axis=2), 0, 1))
    clear = rig.mask(14)
    projected = []
    for name in rig.view_names:
        pixels, visible = rig.project(name, board_corners())
        rows, columns = np.rint(pixels[visible][:, ::-1]).astype(int).T
        projected.append(pixels[visible][clear[rows, columns] > 0])
        assert len(projected[-1]), name
    expected = np.concatenate(projected)
    errors_of(refined(grey.astype(np.uint8), expected), expected, "by cornerSubPix")
    distance = errors_of(np.array([crossing(grey, corner) for corner in expected]), expected, "by crossings")
    assert len(distance) >= 20
    assert distance.max() < FINEST


def test_the_simulator_draws_the_same_picture(rig: Rig, reference: NDArray[np.float32]) -> None:
    exposures = Exposures(rig, MeshRenderer(glowing(room_quads())), CameraSettings(samples=16, blur=0.0))
    ours = exposures.radiance(lambda time: POSE, 0.0)
    valid = rig.mask(SEAM_MARGIN) > 0
    error = eight_bit(ours)[valid].astype(float) - eight_bit(reference)[valid]
    psnr = 10 * np.log10(255**2 / np.mean(error**2))
    everywhere = eight_bit(ours).astype(float) - eight_bit(reference)
    print(
        f"PSNR {psnr:.1f} dB in the views, {10 * np.log10(255**2 / np.mean(everywhere**2)):.1f} dB everywhere"
    )
    assert psnr >= 33.0
    # Stray light takes the same ways too.
    assert 10 * np.log10(255**2 / np.mean(everywhere**2)) >= 30.0
