"""What an .obj names beside itself: files of materials, and their pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


def absent_files(path: Path) -> list[str]:
    """Say which files of materials or pictures an `.obj` names and that are not there."""
    if path.suffix.lower() != ".obj":
        return []
    absent = []
    for name in _named(path, "mtllib"):
        library = path.parent / name
        if not library.is_file():
            absent.append(f"materials {name}")
            continue
        pictures = dict.fromkeys(_named(library, "map_kd"))
        absent += [f"texture {picture}" for picture in pictures if not (library.parent / picture).is_file()]
    more = f" and {len(absent) - 1} more" if len(absent) > 1 else ""
    return [f"{absent[0]}{more} is missing; shown in a flat colour"] if absent else []


def _named(path: Path, keyword: str) -> Iterator[str]:
    """File names after `keyword`, which may hold blanks."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            words = line.strip().split(maxsplit=1)
            if len(words) == 2 and words[0].lower() == keyword and not words[1].startswith("-"):
                yield words[1].replace("\\", "/")
