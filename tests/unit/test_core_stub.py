"""The stub of the native module names what the module has."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import facetcam
from facetcam import _core


def signatures(source: str) -> dict[str, list[str]]:
    """Parameter names of every function in a stub."""
    functions = (node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef))
    return {function.name: [arg.arg for arg in function.args.args] for function in functions}


def test_stub_agrees_with_the_module() -> None:
    stubgen = pytest.importorskip("nanobind.stubgen")
    generator = stubgen.StubGen(_core)
    generator.put(_core)
    committed = (Path(facetcam.__file__).parent / "_core.pyi").read_text()
    assert signatures(committed) == signatures(generator.get())
