"""Maps on disk: one ZIP file of arrays and a header, checked part by part, written whole or not at all.

`docs/how-to/maps.md` describes the format. Nothing in it is code: no pickle is read or written.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from facetcam.config import from_mapping
from facetcam.errors import ConfigError, MapError, RigError
from facetcam.io.outputs import atomic_write
from facetcam.rig import Rig, files

Arrays = dict[str, NDArray[Any]]

FORMAT = "facetcam map"
VERSION = 1
_HEADER = "header.json"
_DAY_ONE = (1980, 1, 1, 0, 0, 0)  # ZIP's own dates say nothing here


@dataclass(frozen=True, slots=True)
class MapHeader:
    """What a map is, without its arrays.

    Attributes
    ----------
    saved : str
        Time of writing, UTC, ISO 8601.
    rig : str
        The rig that made it, as JSON of its `rig.yaml`.
    rig_digest : str
    sessions, keyframes, points : int
    low, high : (3,) tuples
        Corners of the box that holds 98 % of the points, world frame.
    metric : bool
    scale_sigma : float or None
        None where the scale is unknown.
    loops : int
        Loops closed so far.
    """

    saved: str
    rig: str
    rig_digest: str
    sessions: int
    keyframes: int
    points: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    metric: bool
    scale_sigma: float | None
    loops: int

    @classmethod
    def of(
        cls,
        rig: Rig,
        arrays: Arrays,
        sessions: int,
        metric: bool,
        scale_sigma: float,
        loops: int,
    ) -> MapHeader:
        """Describe a map that is about to be written."""
        xyz = arrays["points.xyz"]
        box = np.quantile(xyz, (0.01, 0.99), axis=0) if len(xyz) else np.zeros((2, 3))
        low, high = ((float(x), float(y), float(z)) for x, y, z in box)
        return cls(
            saved=datetime.now(UTC).isoformat(timespec="seconds"),
            rig=json.dumps(files.document(rig)),
            rig_digest=rig.digest,
            sessions=sessions,
            keyframes=len(arrays["keyframes.timestamp"]),
            points=len(xyz),
            low=low,
            high=high,
            metric=metric,
            scale_sigma=float(scale_sigma) if np.isfinite(scale_sigma) else None,
            loops=loops,
        )

    @property
    def size(self) -> tuple[float, float, float]:
        """Extent of the box."""
        x, y, z = (b - a for a, b in zip(self.low, self.high))
        return x, y, z

    def made_by(self) -> Rig:
        """The rig that made the map."""
        return files.from_document(json.loads(self.rig))


def write_map(path: Path, header: MapHeader, arrays: Arrays) -> None:
    """Write a map in place of an older one, which stays if anything fails.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    parts = {f"{name}.npy": _npy(array) for name, array in sorted(arrays.items())}
    sums = {name: hashlib.sha256(part).hexdigest() for name, part in parts.items()}
    head = {"format": FORMAT, "version": VERSION, "map": asdict(header), "sha256": sums}
    text = json.dumps(head, indent=1).encode()
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        archive.comment = hashlib.sha256(text).hexdigest().encode()
        for name, part in ((_HEADER, text), *parts.items()):
            archive.writestr(zipfile.ZipInfo(name, _DAY_ONE), part)
    atomic_write(path, content.getvalue())


def read_map(path: Path | str) -> tuple[MapHeader, Arrays]:
    """Read a map and check all of it.

    Raises
    ------
    MapError
        If the file is missing, no map, of a newer version, or damaged.
    """
    path = Path(path)
    if path.exists() and not path.is_file():  # a pipe would be waited for, whatever else happens
        raise MapError(f"{path}: is not a file")
    try:
        with zipfile.ZipFile(path) as archive:
            head = _head(path, archive)
            header = from_mapping(MapHeader, head.get("map"), f"{path}: header")
            arrays = {
                name.removesuffix(".npy"): _array(path, archive, name, digest)
                for name, digest in head["sha256"].items()
            }
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (zipfile.BadZipFile, KeyError, NotImplementedError, RuntimeError, EOFError) as error:
        raise MapError(f"{path}: {_no_map(path)}") from error
    except ConfigError as error:
        raise MapError(f"{error}; the file is damaged") from error
    _check_sizes(path, header, arrays)
    return header, arrays


def _head(path: Path, archive: zipfile.ZipFile) -> dict[str, Any]:
    """The header, once its own sum is right and its format and version are known."""
    if _HEADER not in archive.namelist():
        raise MapError(f"{path}: is not a map of facetcam (it has no {_HEADER})")
    text = archive.read(_HEADER)
    if hashlib.sha256(text).hexdigest().encode() != archive.comment:
        raise MapError(f"{path}: {_DAMAGED} (checksum of {_HEADER})")
    head = json.loads(text)
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise MapError(f"{path}: is not a map of facetcam")
    if head.get("version") != VERSION:
        raise MapError(
            f"{path}: is a map of version {head.get('version')}, this facetcam reads version {VERSION};"
            " use the facetcam that wrote it, or a newer one"
        )
    return head


_DAMAGED = "is damaged; use a copy of it, or map again"


def _no_map(path: Path) -> str:
    """Whether a file that is no ZIP archive was once a map."""
    with path.open("rb") as file:
        began_as_map = file.read(4) == b"PK\x03\x04"
    return _DAMAGED if began_as_map else "is not a map of facetcam"


def _array(path: Path, archive: zipfile.ZipFile, name: str, digest: str) -> NDArray[Any]:
    part = archive.read(name)
    if hashlib.sha256(part).hexdigest() != digest:
        raise MapError(f"{path}: {_DAMAGED} (checksum of {name})")
    array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(part), allow_pickle=False)
    return array


def _npy(array: NDArray[Any]) -> bytes:
    part = io.BytesIO()
    np.lib.format.write_array(part, np.ascontiguousarray(array), allow_pickle=False)
    return part.getvalue()


def _check_sizes(path: Path, header: MapHeader, arrays: Arrays) -> None:
    """Every part must be there, and fit the others."""
    try:
        sizes = {"points": header.points, "keyframes": header.keyframes}
        sizes |= {table: len(arrays[f"{table}.point"]) for table in ("observations", "sightings")}
    except KeyError as error:
        raise MapError(f"{path}: {_DAMAGED} ({error.args[0]} is absent)") from error
    for name, array in arrays.items():
        if not array.ndim:
            raise MapError(f"{path}: {_DAMAGED} ({name} has no rows)")
        if len(array) != sizes.get(name.split(".")[0], len(array)):
            raise MapError(f"{path}: {_DAMAGED} ({name} has {len(array)} rows)")


def require_rig(path: Path | str, header: MapHeader, rig: Rig) -> None:
    """Refuse a map that another rig made.

    Raises
    ------
    MapError
        With what differs.
    """
    if header.rig_digest == rig.digest:
        return
    try:
        maker = header.made_by()
    except RigError as error:
        raise MapError(f"{path}: {_DAMAGED} (its rig: {error})") from error
    if maker.size != rig.size:
        what = f"its frames were {_by(maker.size)}, this rig's are {_by(rig.size)}"
    elif maker.view_names != rig.view_names:
        what = f"its views were {', '.join(maker.view_names)}, this rig's are {', '.join(rig.view_names)}"
    else:
        what = "its camera or mirrors stand otherwise; a map belongs to the calibration that made it"
    raise MapError(f"{path}: was made by another rig: {what}; give that rig, or map again")


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
