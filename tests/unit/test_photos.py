"""Sets of photos: looked at, remembered, and sorted by what belongs together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_photos import BOARD, SIZE, photo, write_photos
from PIL import Image as Pictures

from facetcam.calibration import BoardSet
from facetcam.errors import SourceError
from facetcam.pipelines import photos as module
from facetcam.pipelines.calibrate_inputs import oversized
from facetcam.pipelines.photo_checks import fit_together, require_boards, require_motion
from facetcam.pipelines.photos import SecondLook, look_at_photos, passed_over, photo_paths

BOARDS = BoardSet((BOARD,))


def test_photos_are_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_photos(tmp_path / "in", [photo(seed=k) for k in range(3)])
    (folder / "01a.png").write_bytes(b"nothing")
    told: list[tuple[int, int | None]] = []
    found, unreadable = look_at_photos(
        photo_paths(folder), BOARDS, tmp_path / "cache", lambda done, total: told.append((done, total))
    )
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [p.path.name for p in found] == ["00.png", "01.png", "02.png"]
    assert [s.photo for p in found for s in p.sightings] == [0, 1, 2]
    assert "01a.png: damaged" in unreadable[0]
    assert all(p.corners == len(BOARD.points) and p.size == SIZE for p in found)
    monkeypatch.setattr(module, "detect", None)  # would raise if anything were looked for again
    again, _ = look_at_photos(photo_paths(folder), BOARDS, tmp_path / "cache")
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.sightings[0].pixels, other.sightings[0].pixels)
        assert (one.digest, one.blur, one.sightings[0].mirrored) == (other.digest, other.blur, False)


def test_an_interrupted_look_is_taken_up_again(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in", [photo(seed=k) for k in range(6)])

    def stop(done: int, total: int | None) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        look_at_photos(photo_paths(folder), BOARDS, tmp_path / "cache", stop)
    assert len(list((tmp_path / "cache").iterdir())) >= 2
    # What was cut off while it was written is looked at again.
    next((tmp_path / "cache").iterdir()).write_bytes(b"PK\x03\x04")
    found, _ = look_at_photos(photo_paths(folder), BOARDS, tmp_path / "cache")
    assert len(found) == 6


def test_other_boards_are_looked_for_anew(tmp_path: Path) -> None:
    folder = write_photos(tmp_path / "in", [photo()])
    assert look_at_photos(photo_paths(folder), BOARDS, tmp_path / "cache")[0][0].sightings
    others = BoardSet((replace(BOARD, first_id=30),))
    assert not look_at_photos(photo_paths(folder), others, tmp_path / "cache")[0][0].sightings


def test_many_photos_need_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many there are, only a few wait to be looked at or have been looked at ahead."""
    paths = [tmp_path / f"{k}.png" for k in range(500)]
    begun: list[Path] = []
    monkeypatch.setattr(module, "_look_at", lambda path, boards, cache: begun.append(path) or str(path))
    ahead = []
    for done, _ in enumerate(module._looked(paths, BOARDS, None), start=1):
        ahead.append(len(begun) - done)
    assert len(begun) == 500
    assert max(ahead) <= 2 * (module.os.cpu_count() or 1)


def test_missing_photos(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no such folder"):
        photo_paths(tmp_path / "x")
    with pytest.raises(SourceError, match="no photos in this folder"):
        photo_paths(tmp_path)
    with pytest.raises(SourceError, match="no such photo"):
        photo_paths([tmp_path / "a.png"])
    with pytest.raises(SourceError, match="none of 1 can be read"):
        look_at_photos([tmp_path], BOARDS)


def test_photos_that_do_not_belong_are_left_out(tmp_path: Path) -> None:
    images = [photo(seed=k) for k in range(5)]
    images += [images[0], photo(seed=7, size=(320, 240)), cv2.GaussianBlur(photo(seed=8), (0, 0), 3)]
    folder = write_photos(tmp_path / "in", images)
    for index, model in enumerate(["A"] * 4 + ["B"]):
        exif = Pictures.Exif()
        exif[0x0110] = model
        with Pictures.open(folder / f"{index:02d}.png") as picture:
            picture.save(folder / f"{index:02d}.png", exif=exif)
    cv2.imwrite(str(folder / "05.png"), cv2.imread(str(folder / "00.png"), 0))
    (folder / "00copy.png").write_bytes((folder / "00.png").read_bytes())
    found, _ = look_at_photos(photo_paths(folder), BOARDS)
    kept, warnings = fit_together(found, None)
    names = [p.path.name for p in kept]
    assert names == ["00.png", "01.png", "02.png", "03.png", "05.png"]
    assert [s.photo for p in kept for s in p.sightings] == [0, 1, 2, 3, 4]
    said = "\n".join(warnings)
    assert "not 640x480 pixels: 06.png" in said
    assert "the same file as another photo: 00copy.png" in said
    assert "taken with B, the others with A: 04.png" in said
    assert "blurred" in said and "07.png" in said
    with pytest.raises(SourceError, match=r"the camera of rig\.yaml is 100x100"):
        fit_together(found, (100, 100), "rig.yaml")


@pytest.mark.parametrize("blurred", [True, False])
def test_photos_that_cannot_be_read_are_called_blurred_if_they_are(tmp_path: Path, blurred: bool) -> None:
    other = cv2.GaussianBlur(photo(seed=3), (0, 0), 6) if blurred else 255 - photo(seed=3)
    folder = write_photos(tmp_path, [photo(seed=1), photo(seed=2), other])
    found, _ = look_at_photos(photo_paths(folder), BOARDS)
    _, (warning,) = fit_together(found, SIZE)
    assert (
        f"1 of 3 photos shows no board that could be read{', blurred' if blurred else ''}: 02.png" in warning
    )


def test_photos_from_one_pose(tmp_path: Path) -> None:
    still = [photo(seed=3)] * 3
    noisy = [np.clip(s + np.random.default_rng(k).normal(0, 2, s.shape), 0, 255) for k, s in enumerate(still)]
    folder = write_photos(tmp_path / "in", [n.astype(np.uint8) for n in noisy])
    found, _ = look_at_photos(photo_paths(folder), BOARDS)
    with pytest.raises(SourceError, match="3 photos show the boards in the same places"):
        require_motion(found)
    cv2.imwrite(str(folder / "03.png"), photo(seed=4))
    require_motion(look_at_photos(photo_paths(folder), BOARDS)[0])


@pytest.mark.parametrize(
    ("told", "hint"),
    [
        (replace(BOARD, dictionary="DICT_6X6_250"), "the photos show markers of DICT_4X4_50, ids up to 14"),
        (replace(BOARD, marker=0.012), "a marker of about 0.022"),
        (replace(BOARD, first_id=20), "is this their boards.yaml"),
    ],
)
def test_no_board_found(tmp_path: Path, told: object, hint: str) -> None:
    folder = write_photos(tmp_path / "in", [photo(seed=1)])
    boards = BoardSet((told,))  # type: ignore[arg-type]
    found, _ = look_at_photos(photo_paths(folder), boards)
    with pytest.raises(SourceError) as caught:
        require_boards(found, boards, tmp_path / "out")
    assert "no board found in 1 photo; looked for wall (charuco 6x5" in str(caught.value)
    assert hint in str(caught.value)
    assert cv2.imread(str(tmp_path / "out-what-was-seen.jpg")).shape == (480, 640, 3)


def test_a_board_of_other_columns(tmp_path: Path) -> None:
    board = replace(BOARD, squares=(8, 9), dictionary="DICT_5X5_100")
    folder = write_photos(tmp_path / "in", [photo(board, seed=1, spread=20)])
    boards = BoardSet((replace(board, squares=(9, 8)),))
    found, _ = look_at_photos(photo_paths(folder), boards)
    with pytest.raises(SourceError, match="8 columns would fit, not 9"):
        require_boards(found, boards, tmp_path / "out")


def test_the_second_look_reads_photos_again(tmp_path: Path) -> None:
    found, _ = look_at_photos(photo_paths(write_photos(tmp_path / "in", [photo(), photo(seed=2)])), BOARDS)
    look = SecondLook(found)
    (sighting,) = found[1].sightings
    pixels, accepted = look(1, sighting.pixels + 0.7, np.full(len(sighting), 60.0))
    assert accepted.all()
    assert np.abs(pixels - sighting.pixels).max() < 0.15


def test_a_folder_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(folder: Path) -> Iterator[Path]:
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(Path, "iterdir", refused)
    with pytest.raises(SourceError, match=r"cannot be read \(Permission denied\)"):
        photo_paths(tmp_path)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("IMG_1.HEIC", ".HEIC photos are not read; save them as JPEG"), ("a.MP4", "a film; save")],
)
def test_pictures_that_are_not_read_are_named(tmp_path: Path, name: str, remedy: str) -> None:
    (tmp_path / name).write_bytes(b"\0")
    for what in (tmp_path, tmp_path / name):
        with pytest.raises(SourceError, match=f"{name}: {remedy}"):
            photo_paths(what)
    write_photos(tmp_path, [photo(seed=k) for k in range(2)])
    (tmp_path / "a folder.jpg").mkdir()
    (tmp_path / "notes.txt").touch()
    assert [path.name for path in photo_paths(tmp_path)] == ["00.png", "01.png"]
    (line,) = passed_over(tmp_path)
    assert f"1 file passed over, such as {name}: {remedy}" in line
    assert passed_over([tmp_path / "00.png"]) == []


def test_photos_turned_by_a_program(tmp_path: Path) -> None:
    folder = write_photos(tmp_path, [photo(seed=1), cv2.rotate(photo(seed=2), cv2.ROTATE_90_CLOCKWISE)])
    found, _ = look_at_photos(photo_paths(folder), BOARDS)
    _, (warning,) = fit_together(found, SIZE)
    assert "left out, not 640x480 pixels (turned by a program?" in warning
    with pytest.raises(SourceError, match=r"480x640.*turned by a program\?"):
        fit_together(found[1:], SIZE)


@pytest.mark.parametrize(("factor", "wide"), [(30.0, "5.4"), (0.03, "0.0054")])
def test_squares_told_in_other_units(factor: float, wide: str) -> None:
    told = replace(BOARD, square=factor * BOARD.square, marker=factor * BOARD.marker)
    (line,) = oversized(BoardSet((told,)))
    assert f"board 'wall' would be {wide} m wide" in line
    assert oversized(BOARDS) == []
    (both,) = oversized(BoardSet((told, replace(told, name="floor", first_id=20))))
    assert f"boards 'wall', 'floor' would be {wide} m wide" in both
