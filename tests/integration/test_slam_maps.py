"""Saved maps: gone on in, looked in from another heading, and refused where they cannot be right."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import Facetcam, only_line
from numpy.typing import NDArray
from slam_worlds import folded, pyramid

from facetcam.errors import MapError
from facetcam.geometry import se3
from facetcam.rig import Rig
from facetcam.simulation.drive import Drive, round_the_table, wheel_odometry
from facetcam.simulation.film import Film, renderer_of
from facetcam.simulation.mesh_renderer import MeshRenderer
from facetcam.simulation.room import furnished_room
from facetcam.slam import Slam, State, Status
from facetcam.slam.camera.frame import make_frame
from facetcam.slam.map.file import read_map, write_map

Array = NDArray[np.float64]

FRAMES = 20


@pytest.fixture(scope="module")
def room() -> MeshRenderer:
    return renderer_of(furnished_room())


@pytest.fixture(scope="module")
def drive() -> Drive:
    return round_the_table(FRAMES)


def mapped(rig: Rig, room: MeshRenderer, drive: Drive, path: Path) -> Path:
    slam, wheels = Slam(rig), wheel_odometry(drive)
    for image, time, xyt in zip(Film(rig, room, drive), drive.times, wheels):
        slam.track(image, time, xyt)
    slam.finish()
    slam.save_map(path)
    return path


@pytest.fixture(scope="module")
def saved(room: MeshRenderer, drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return mapped(folded(), room, drive, tmp_path_factory.mktemp("maps") / "room.facetmap")


def turned(drive: Drive, degrees: float, frames: slice) -> Drive:
    """The same places with the rig turned on the spot."""
    turn = se3.exp([0, 0, np.radians(degrees), 0, 0, 0])
    return replace(drive, times=drive.times[frames], poses=drive.poses[frames] @ turn)


def look_in(path: Path, rig: Rig, room: MeshRenderer, drive: Drive) -> list[State]:
    slam = Slam(rig)
    slam.load_map(path, localise_only=True)
    return [slam.track(image, time) for image, time in zip(Film(rig, room, drive), drive.times)]


def T_true_map(path: Path, drive: Drive) -> Array:
    """Where the map's frame lies in the true world, from its first keyframe."""
    _, arrays = read_map(path)
    k = np.searchsorted(drive.times, arrays["keyframes.timestamp"][0])
    return drive.poses[k] @ se3.inverse(arrays["keyframes.T_world_rig"][0])


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_kidnapped_rig_is_found_whatever_its_heading(
    saved: Path, room: MeshRenderer, drive: Drive, degrees: float
) -> None:
    """What the front mirrors showed comes back in others, truly rendered there."""
    there = turned(drive, degrees, slice(12, 16))
    states = look_in(saved, folded(), room, there)
    found = [k for k, state in enumerate(states) if state.status is Status.TRACKING]
    assert found, [state.status for state in states]
    assert all(states[k].T_world_rig is None for k in range(found[0]))
    for k in found:
        T = T_true_map(saved, drive) @ states[k].T_world_rig
        error = se3.log(se3.inverse(there.poses[k]) @ T)
        assert np.linalg.norm(error[3:]) < 0.05
        assert np.degrees(np.linalg.norm(error[:3])) < 1.0


def test_a_guess_that_is_centimetres_off_is_no_reason_for_a_pose_to_be(
    saved: Path, room: MeshRenderer, drive: Drive
) -> None:
    rig, rng, there = folded(), np.random.default_rng(0), turned(drive, 0, slice(10, 11))
    slam = Slam(rig)
    slam.load_map(saved, localise_only=True)
    frame = make_frame(next(iter(Film(rig, room, there))), 0.0, rig.size)
    T = se3.inverse(T_true_map(saved, drive)) @ there.poses[0]
    tracker, off = slam._parts.tracker, np.zeros((2, 16))
    for i, way in enumerate(rng.normal(size=(off.shape[1], 3))):
        guess = T @ se3.exp([0, 0, 0, *(0.06 * way / np.linalg.norm(way))])
        for j, locate in enumerate((tracker.locate, tracker.locate_from_afar)):
            fix = locate(frame, guess)
            off[j, i] = np.inf if fix is None else np.linalg.norm((fix.T_world_rig - T)[:3, 3])
    once, again = np.count_nonzero(off < 0.005, axis=1)
    assert again >= once + 3 and again >= 10, np.round(1e3 * off, 1)


@pytest.mark.slow
def test_mirror_images_are_found_in_mirror_images(room: MeshRenderer, drive: Drive, tmp_path: Path) -> None:
    """Every view of this rig is behind one mirror; a turn by a third of a circle swaps them."""
    path = mapped(pyramid(), room, drive, tmp_path / "pyramid.facetmap")
    there = turned(drive, 120, slice(12, 18))
    states = look_in(path, pyramid(), room, there)
    last = states[-1]
    assert last.status is Status.TRACKING
    T = T_true_map(path, drive) @ last.T_world_rig
    assert np.linalg.norm(T[:3, 3] - there.poses[-1][:3, 3]) < 0.08


def test_the_creep_stays_with_the_map_and_goes_with_it(saved: Path, tmp_path: Path) -> None:
    slam, again, creep = Slam(folded()), Slam(folded()), [0.3, -0.2]
    slam.load_map(saved)
    before = slam._map.keyframes[1].observations.plane
    slam._parts.adjuster.believe(np.array([0.0, *creep]))
    slam.save_map(tmp_path / "crept.facetmap")
    again.load_map(tmp_path / "crept.facetmap", localise_only=True)
    for loaded in (slam, again):
        assert loaded.nuisances[1:].tolist() == creep
        assert loaded.rig_as_seen.camera.cx == pytest.approx(folded().camera.cx + 0.3)
        seen = loaded._map.keyframes[1].observations
        assert 0.2 < np.abs(seen.plane - before).max() < 0.6
        np.testing.assert_allclose(seen.plane, loaded._parts.optics.plane(seen.pixels, seen.view))
    again._grower.start_again()
    assert not again.nuisances.any() and again.rig_as_seen.camera == again.rig.camera


def test_what_repeats_stays_known_and_a_map_that_never_knew_is_read(saved: Path, tmp_path: Path) -> None:
    header, arrays = read_map(saved)
    assert 0.05 < arrays["points.repeated"].mean() < 0.95
    older = {name: array for name, array in arrays.items() if name != "points.repeated"}
    write_map(tmp_path / "older.facetmap", header, older)
    for path, known in ((saved, arrays["points.repeated"]), (tmp_path / "older.facetmap", False)):
        slam = Slam(folded())
        slam.load_map(path)
        np.testing.assert_array_equal(slam._map.points.repeated, known)


@pytest.mark.parametrize("creep", [np.zeros(3), np.full(2, np.nan), np.zeros((2, 2)), np.array(["a", "b"])])
def test_a_map_with_a_creep_that_is_none_is_refused(saved: Path, tmp_path: Path, creep: Array) -> None:
    header, arrays = read_map(saved)
    write_map(tmp_path / "odd.facetmap", header, arrays | {"camera.creep": creep})
    with pytest.raises(MapError, match=r"odd\.facetmap: its parts contradict each other"):
        Slam(folded()).load_map(tmp_path / "odd.facetmap")


def with_first(array: Array, value: float) -> Array:
    """The same with another first row."""
    spoiled = array.copy()
    spoiled[0] = value
    return spoiled


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("points.patch", lambda a: a[:, :9, :9].copy()),
        ("points.patch", lambda a: a.astype(float)),
        ("points.offset", lambda a: with_first(a, 30.0)),
        ("points.offset", lambda a: with_first(a, np.nan)),
        ("points.xyz", lambda a: with_first(a, np.inf)),
        ("points.jacobian", lambda a: with_first(a, 0.0)),
        ("keyframes.T_world_rig", lambda a: with_first(a, 0.0)),
        ("keyframes.timestamp", lambda a: with_first(a, np.nan)),
        ("observations.keyframe", lambda a: a[::-1].copy()),
        ("observations.pixels", lambda a: a[:, :1].copy()),
        ("observations.point", lambda a: with_first(a, -1)),
        ("sightings.descriptor", lambda a: a[:, :5].copy()),
        ("camera.creep", lambda a: a[0]),
    ],
)
def test_a_map_with_parts_that_are_none_is_refused(
    saved: Path, tmp_path: Path, name: str, spoil: Callable[[Array], Array]
) -> None:
    header, arrays = read_map(saved)
    write_map(tmp_path / "odd.facetmap", header, arrays | {name: np.asarray(spoil(arrays[name]))})
    with pytest.raises(MapError, match=rf"odd\.facetmap: .*{name}"):
        Slam(folded()).load_map(tmp_path / "odd.facetmap")


def test_nowhere_is_not_found(saved: Path) -> None:
    rng = np.random.default_rng(3)
    slam = Slam(folded())
    slam.load_map(saved, localise_only=True)
    for k in range(4):
        noise = rng.integers(0, 256, (600, 800)).astype(np.uint8)
        state = slam.track(noise, k / 10, (0.1 * k, 0.0, 0.0))
        assert state.status is Status.LOST  # wheels alone do not say where in the map
        assert state.T_world_rig is None


def test_a_map_is_extended_in_its_own_frame(
    saved: Path, room: MeshRenderer, drive: Drive, tmp_path: Path
) -> None:
    further = round_the_table(28)
    later = replace(further, times=further.times[17:], poses=further.poses[17:])
    slam = Slam(folded())
    before = slam.load_map(saved)
    states = [slam.track(image, time) for image, time in zip(Film(folded(), room, later), later.times)]
    assert states[-1].status is Status.TRACKING
    slam.finish()
    _, poses = slam.trajectory()
    own = T_true_map(saved, drive) @ poses[-1]
    assert np.linalg.norm(own[:3, 3] - later.poses[-1][:3, 3]) < 0.05
    slam.save_map(tmp_path / "more.facetmap")
    after, _ = read_map(tmp_path / "more.facetmap")
    assert (after.sessions, before.sessions) == (2, 1)
    assert after.keyframes > before.keyframes and after.points > before.points


def test_only_looking_changes_nothing(saved: Path, room: MeshRenderer, drive: Drive, tmp_path: Path) -> None:
    slam = Slam(folded())
    slam.load_map(saved, localise_only=True)
    for image, time in zip(Film(folded(), room, turned(drive, 0, slice(10, 14))), drive.times):
        slam.track(image, time)
    slam.finish()
    assert not slam.grown
    slam.save_map(tmp_path / "same.facetmap")
    (_, old), (_, new) = read_map(saved), read_map(tmp_path / "same.facetmap")
    counted = {"points.predicted", "points.found"}
    for name in old.keys() - counted:
        np.testing.assert_array_equal(old[name], new[name], err_msg=name)


def test_no_damaged_byte_goes_unnoticed(saved: Path, tmp_path: Path) -> None:
    """Every flipped byte is refused, or lies where it means nothing and leaves all content as it was."""
    content = saved.read_bytes()
    _, whole = read_map(saved)
    rng, path = np.random.default_rng(5), tmp_path / "damaged.facetmap"
    edges = [0, 10, 40, len(content) - 30, len(content) - 100, len(content) - 2]
    refused = 0
    for place in [*edges, *rng.integers(0, len(content), 25).tolist()]:
        flipped = bytearray(content)
        flipped[place] ^= 0x55
        path.write_bytes(flipped)
        try:
            _, arrays = read_map(path)
        except MapError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            assert all(np.array_equal(whole[name], arrays[name]) for name in whole)
    assert refused > 25


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.999])
def test_cut_off_maps_are_refused(saved: Path, tmp_path: Path, share: float) -> None:
    content, path = saved.read_bytes(), tmp_path / "cut.facetmap"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(MapError, match=r"damaged|not a map"):
        read_map(path)


def with_header(path: Path, target: Path, **changes: object) -> Path:
    """A copy with another header, its own checksum made right."""
    import hashlib

    with zipfile.ZipFile(path) as source:
        head = json.loads(source.read("header.json")) | changes
        text = json.dumps(head).encode()
        with zipfile.ZipFile(target, "w") as copy:
            copy.comment = hashlib.sha256(text).hexdigest().encode()
            copy.writestr("header.json", text)
            for name in source.namelist()[1:]:
                copy.writestr(name, source.read(name))
    return target


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"version": 2}, "version 2, this facetcam reads version 1"),
        ({"format": "another"}, "not a map"),
        ({"map": {"saved": "now"}}, "damaged"),
        ({"sha256": {}}, "damaged"),
    ],
)
def test_foreign_headers_are_refused(
    saved: Path, tmp_path: Path, changes: dict[str, object], says: str
) -> None:
    with pytest.raises(MapError, match=says) as caught:
        read_map(with_header(saved, tmp_path / "foreign.facetmap", **changes))
    assert "\n" not in str(caught.value)


def test_pickles_are_never_opened(saved: Path, tmp_path: Path) -> None:
    header, arrays = read_map(saved)
    arrays["points.xyz"] = np.array([{}, []], dtype=object)
    with pytest.raises(ValueError, match="Object arrays"):
        write_map(tmp_path / "pickle.facetmap", header, arrays)
    part = io.BytesIO()
    np.save(part, arrays["points.xyz"], allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "plain.facetmap", "w") as archive:
        archive.writestr("points.xyz.npy", part.getvalue())
    with pytest.raises(MapError, match="not a map"):
        read_map(tmp_path / "plain.facetmap")


def test_folders_and_pipes_are_no_maps(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")  # nobody writes into it: opening it would wait for ever
    for place in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(MapError, match="is not a file"):
            read_map(place)


def test_maps_of_other_rigs_are_refused_with_what_differs(saved: Path) -> None:
    rig = folded()
    bent = replace(rig, camera=replace(rig.camera, fx=rig.camera.fx + 3.0))
    renamed = replace(rig, views={f"{name}2": view for name, view in rig.views.items()})
    larger = replace(rig, camera=replace(rig.camera, width=900))
    for other, says in ((bent, "stand otherwise"), (renamed, "its views were"), (larger, "800x600")):
        with pytest.raises(MapError, match=says):
            Slam(other).load_map(saved)


def test_a_map_comes_before_the_first_frame(saved: Path) -> None:
    slam = Slam(folded())
    slam.track(np.zeros((600, 800), np.uint8), 0.0)
    with pytest.raises(MapError, match="before the first frame"):
        slam.load_map(saved)


def test_info_says_what_a_map_is(facetcam: Facetcam, saved: Path, tmp_path: Path) -> None:
    result = facetcam("map", "info", saved)
    assert result.exit_code == 0, result.output
    header, _ = read_map(saved)
    for told in ("800x600", "METRIC", f"{header.keyframes}, {header.points}", "undamaged"):
        assert told in result.stdout
    assert json.loads(facetcam("map", "info", saved, "--format", "json").stdout)["saved"] == header.saved
    (tmp_path / "text").write_text("no map")
    assert "not a map" in only_line(facetcam("map", "info", tmp_path / "text"))
    assert "cannot be read" in only_line(facetcam("map", "info", tmp_path / "absent"))
