"""Layers of the Rust crates: what a top-level module may import, as DESIGN.md says."""

from pathlib import Path

import pytest
from design_tables import uses
from rust_imports import Graph, branches, circles, imports

ROOT = Path(__file__).parents[2]
CRATES = ["engine", "view", "live"]


def layers(crate: str) -> dict[str, set[str]]:
    """The table of a crate in DESIGN.md: module, and what it may use."""
    return dict(uses(f"layers of `{crate}`"))


def graph(crate: str) -> Graph:
    return imports(ROOT / "core-rs" / crate / "src")


@pytest.mark.parametrize("crate", CRATES)
def test_rust_modules_import_only_lower_layers(crate: str):
    may = layers(crate)
    result = graph(crate)
    assert {module[0] for module in result if module} == set(may), "every module is in the table"
    for module, others in result.items():
        for other in others:
            if module and other and other[0] != module[0]:
                what = f"{'/'.join(module)}.rs imports {'::'.join(other)}"
                assert other[0] in may[module[0]], what


@pytest.mark.parametrize("crate", CRATES)
def test_rust_layers_listed_in_order(crate: str):
    seen: set[str] = set()
    for layer, may in layers(crate).items():
        assert may <= seen, f"{layer} may use what stands below it in the table: {may - seen}"
        seen.add(layer)


@pytest.mark.parametrize("crate", CRATES)
def test_rust_files_without_import_cycles(crate: str):
    """Only a file and its own children may name each other."""
    kin = lambda a, b: a[: len(b)] == b or b[: len(a)] == a  # noqa: E731
    strangers = {
        module: {other for other in others if not kin(module, other)}
        for module, others in graph(crate).items()
    }
    assert circles(strangers) == []


def test_branches_of_rust_use_lines():
    assert branches("a::{b, c::{d, e as f}, self}") == ["a::b", "a::c::d", "a::c::e", "a::self"]


def test_circles_of_import_graph():
    a, b, c = ("a",), ("b",), ("c",)
    assert circles({a: {b}, b: {c}, c: {b}}) == [[b, c]]
