"""The public list of the package: short, whole, and imported only when used."""

from __future__ import annotations

import subprocess
import sys

import pytest

import facetcam


@pytest.mark.parametrize("name", facetcam.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(facetcam, name).__name__ == name


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Unwrap'"):
        _ = facetcam.Unwrap


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import sys, facetcam; print(sorted({'numpy', 'cv2', 'scipy', 'pycolmap'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
