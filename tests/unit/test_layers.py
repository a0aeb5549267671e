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
RANK = {unit: rank for rank, units in enumerate(LAYERS) for unit in units}


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


def broken_rules(module: str, source: str) -> list[str]:
    """One line for each import that leaves the module's unit other than downward."""
    own = module.split(".")[1]
    found = []
    for name in imported_names(module, source):
        root, _, rest = name.partition(".")
        unit = rest.split(".")[0]
        if root != "facetcam" or unit in (own, "__version__"):
            continue
        if unit not in RANK:
            found.append(f"{module} imports {name}: name the layer's module, not the public list")
        elif RANK[unit] >= RANK[own]:
            found.append(f"{module} imports {name}: {unit} is not below {own}")
    return found


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
