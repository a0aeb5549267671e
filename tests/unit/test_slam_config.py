"""Settings of tracking and mapping that have no meaning are refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from facetcam.config import load_config
from facetcam.errors import ConfigError
from facetcam.slam.config import SlamConfig

NUMBERS = [f.name for f in dataclasses.fields(SlamConfig) if f.type in ("int", "float")]


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", [-3, 10**9])
def test_a_number_without_meaning_is_refused_by_name(name: str, value: int, tmp_path: Path) -> None:
    (tmp_path / "slam.yaml").write_text(f"{name}: {value}\n")
    with pytest.raises(ConfigError, match=f"slam.yaml.*{name} is .* must be between"):
        load_config(SlamConfig, tmp_path / "slam.yaml")


def test_the_defaults_are_inside() -> None:
    assert len(NUMBERS) == 19
    SlamConfig()
