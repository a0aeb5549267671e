"""The layers of the package: a module imports only from lower ones (docs/conventions.md draws them)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import facetcam

PACKAGE = Path(facetcam.__file__).parent

# Lowest first; the units of one layer do not import each other.
LAYERS = (
    {"errors", "_core"},
    {"geometry"},
    {"config"},
    {"rig"},
    {"unwrapping", "features", "simulation", "design"},
    {"io", "calibration", "evaluation"},
    {"slam"},
    {"viz"},
    {"pipelines"},
    {"cli"},
    {"__main__"},
)
SLAM = (
    {"config", "state", "stopwatch", "threads"},
    {"camera", "odometry"},
    {"map", "relative_pose"},
    {"adjustment"},
    {"scale", "rig_check", "tracking"},
    {"mapping"},
    {"parts"},
    {"main_loop", "wheels"},
    {"system"},
)


def ranks(layers: tuple[set[str], ...]) -> dict[str, int]:
    """The layer of each unit."""
    return {unit: rank for rank, units in enumerate(layers) for unit in units}


RANK = ranks(LAYERS)
SLAM_RANK = ranks(SLAM)


def modules() -> Iterator[tuple[str, str]]:
    """Dotted name and source of every module but the root `__init__`, the public list above all layers."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts != ("__init__",):
            yield ".".join(("facetcam", *parts)), path.read_text()


def imported_names(module: str, source: str) -> Iterator[str]:
    """Absolute dotted names of everything that a module imports, wherever in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = module.split(".")[: -node.level] if node.level else []
            prefix = [*base, *([node.module] if node.module else [])]
            yield from (".".join([*prefix, alias.name]) for alias in node.names)


def broken_rules(module: str, source: str, root: str = "facetcam", rank: dict[str, int] = RANK) -> list[str]:
    """One line for each import that leaves the module's unit of `root` other than downward."""
    own = unit_of(module, root)
    found = []
    for name in imported_names(module, source):
        if not f"{name}.".startswith(f"{root}."):
            continue
        unit = unit_of(name, root)
        if unit in (own, "__version__"):
            continue
        if unit not in rank:
            found.append(f"{module} imports {name}: name the layer's module, not the public list")
        elif rank[unit] >= rank[own]:
            found.append(f"{module} imports {name}: {unit} is not below {own}")
    return found


def unit_of(name: str, root: str) -> str:
    """The part of `root` that a dotted name lies in."""
    return name.removeprefix(f"{root}.").split(".")[0]


def of_slam() -> list[tuple[str, str]]:
    """The modules of `facetcam.slam` but its public list."""
    return [m for m in modules() if m[0].startswith("facetcam.slam.") and m[0] != "facetcam.slam.__init__"]


def test_every_unit_has_a_layer() -> None:
    units = {name.split(".")[1] for name, _ in modules()}
    assert units <= RANK.keys()


def test_imports_go_downward() -> None:
    assert [line for name, source in modules() for line in broken_rules(name, source)] == []


def test_the_rules_catch_an_upward_import() -> None:
    assert broken_rules("facetcam.rig.camera", "from facetcam.slam.system import Slam")
    assert broken_rules("facetcam.rig.camera", "def f():\n    from ..slam import Slam")
    assert broken_rules("facetcam.features.siicf", "import facetcam.unwrap")
    assert broken_rules("facetcam.cli.main", "from facetcam import Slam")
    assert not broken_rules("facetcam.slam.system", "from ..rig import Rig\nfrom facetcam import __version__")


def test_every_unit_of_slam_has_a_layer() -> None:
    assert {unit_of(name, "facetcam.slam") for name, _ in of_slam()} == SLAM_RANK.keys()


def test_imports_go_downward_within_slam() -> None:
    rules = "facetcam.slam", SLAM_RANK
    assert [line for name, source in of_slam() for line in broken_rules(name, source, *rules)] == []


def test_the_rules_catch_an_upward_import_within_slam() -> None:
    rules = "facetcam.slam", SLAM_RANK
    upward = "from facetcam.slam.mapping.starter import Starter"
    assert broken_rules("facetcam.slam.tracking.motion", upward, *rules)
    assert broken_rules("facetcam.slam.map.map", "from facetcam.slam import Slam", *rules)
    assert not broken_rules("facetcam.slam.mapping.mapper", "from facetcam.slam.map.map import Map", *rules)
