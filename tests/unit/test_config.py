"""Settings are read strictly."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from facetcam.config import from_mapping, load_config, require_ranges
from facetcam.errors import ConfigError


@dataclass(frozen=True)
class Lamp:
    power: float = 1.0
    colour: tuple[int, int, int] = (255, 255, 255)


@dataclass(frozen=True)
class Room:
    name: str = "hall"
    doors: int = 1
    lit: bool = True
    mode: Literal["day", "night"] = "day"
    limit: int | None = None
    spots: tuple[float, ...] = ()
    plan: Path = Path("plan.txt")
    lamp: Lamp = field(default_factory=Lamp)


def test_no_file_gives_the_defaults() -> None:
    assert load_config(Room, None) == Room()


def test_a_whole_file_is_read_into_its_types(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(
        "name: kitchen\ndoors: 2\nlit: false\nmode: night\nlimit: 3\nspots: [1, 2.5]\nplan: a/b.txt\n"
        "lamp: {power: 2, colour: [1, 2, 3]}\n"
    )
    expected = Room("kitchen", 2, False, "night", 3, (1.0, 2.5), Path("a/b.txt"), Lamp(2.0, (1, 2, 3)))
    assert load_config(Room, path) == expected
    assert isinstance(load_config(Room, path).lamp.power, float)


def test_an_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    (tmp_path / "empty.yaml").write_text("# nothing set\n")
    assert load_config(Room, tmp_path / "empty.yaml") == Room()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"doorz": 2}, "unknown key 'doorz'; did you mean 'doors'?"),
        ({"lamp": {"powr": 2}}, "lamp: unknown key 'powr'; did you mean 'power'?"),
        ({"xyzzy": 2}, "unknown key 'xyzzy'; known are doors, lamp"),
        ({"doors": "two"}, "doors: expected int, got 'two'"),
        ({"doors": 2.5}, "doors: expected int, got 2.5"),
        ({"doors": True}, "doors: expected int, got True"),
        ({"lit": 1}, "lit: expected bool, got 1"),
        ({"mode": "dusk"}, "mode: 'dusk' is not one of 'day', 'night'"),
        ({"spots": 3.0}, "spots: expected a list, got 3.0"),
        ({"spots": [1.0, float("nan")]}, r"spots\[1\]: must be finite, got nan"),
        ({"lamp": {"colour": [1, 2]}}, "lamp: colour: expected 3 values, got 2"),
        ({"lamp": 3}, "lamp: expected keys with values, got 3"),
        ([1, 2], r"expected keys with values, got \[1, 2\]"),
    ],
)
def test_a_wrong_setting_is_named(values: object, message: str) -> None:
    with pytest.raises(ConfigError, match=f"^room.yaml: {message}"):
        from_mapping(Room, values, "room.yaml")


@dataclass(frozen=True)
class Needy:
    size: int


def test_a_missing_key_is_named() -> None:
    with pytest.raises(ConfigError, match="missing key 'size'"):
        from_mapping(Needy, {}, "file")


@pytest.mark.parametrize("content", [b"a: [1", b"\xff\xfe\x00", None])
def test_an_unreadable_file_is_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "broken.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"broken\.yaml") as caught:
        load_config(Room, path)
    assert "\n" not in str(caught.value)


@dataclass(frozen=True)
class Judge:
    size: float = 1.0

    def __post_init__(self) -> None:
        require_ranges("judge", self, size=(0.0, 2.0))


def test_a_file_is_named_before_what_a_class_says_of_its_own_values(tmp_path: Path) -> None:
    path = tmp_path / "judge.yaml"
    path.write_text("size: 3\n")
    with pytest.raises(ConfigError) as caught:
        load_config(Judge, path)
    assert str(caught.value) == f"{path}: judge: size is 3; it must be between 0 and 2"
    path.write_text("sise: 3\n")  # named already, and not twice
    with pytest.raises(ConfigError) as caught:
        load_config(Judge, path)
    assert str(caught.value) == f"{path}: unknown key 'sise'; did you mean 'size'?"
