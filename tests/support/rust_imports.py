"""What each Rust file of a crate imports, read from its `use` lines and its paths."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

Module = tuple[str, ...]
Graph = dict[Module, set[Module]]


def imports(source: Path) -> Graph:
    """Every file of a crate without its tests, and the files that it names."""
    files = {}
    for path in source.rglob("*.rs"):
        module = path.relative_to(source).with_suffix("").parts
        if "tests" not in module:
            files[() if module == ("lib",) else module] = code(path.read_text(encoding="utf-8"))
    return {module: set(named(module, text, files)) for module, text in files.items()}


def code(text: str) -> str:
    """A file without its comments and its tests."""
    text = re.sub(r"//[^\n]*", "", text)
    return re.sub(r"#\[cfg\(test\)\]\s*mod \w+ \{.*", "", text, flags=re.DOTALL)


def named(module: Module, text: str, files: Iterable[Module]) -> Iterator[Module]:
    """The files that a file imports."""
    uses = re.findall(r"\buse\s+([^;]+);", text)
    rest = re.sub(r"\buse\s+[^;]+;", "", text)
    paths = [path for use in uses for path in branches(" ".join(use.split()))]
    for path in paths + re.findall(r"\b((?:crate|super)(?:::\w+)+)", rest):
        target = resolved(module, [part.strip() for part in path.split("::")], files)
        if target and target != module:
            yield target


def branches(tree: str) -> list[str]:
    """The paths of a tree of imports: `a::{b, c::{d, e}}` has three."""
    tree = tree.split(" as ")[0].strip() if "{" not in tree else tree.strip()
    if "{" not in tree:
        return [tree]
    stem, inner = tree[: tree.index("{")], tree[tree.index("{") + 1 : tree.rindex("}")]
    result, depth, item = [], 0, ""
    for letter in inner + ",":
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            result += [stem + path for path in branches(item)] if item.strip() else []
            item = ""
        else:
            item += letter
    return result


def resolved(module: Module, path: list[str], files: Iterable[Module]) -> Module:
    """The file of a path; empty if it is not in this crate."""
    if path[0] == "crate":
        full = path[1:]
    elif path[0] == "self":
        full = [*module, *path[1:]]
    elif path[0] == "super":
        ups = next((i for i, part in enumerate(path) if part != "super"), len(path))
        full = [*module[: len(module) - ups], *path[ups:]]
    else:
        full = [*module, *path]
        if tuple(full[: len(module) + 1]) not in files:
            return ()
    while full and tuple(full) not in files:
        full.pop()
    return tuple(full)


def circles(graph: Graph) -> list[list[Module]]:
    """Sets of modules that import one another in a circle (Tarjan 1972)."""
    index: dict[Module, int] = {}
    low: dict[Module, int] = {}
    stack: list[Module] = []
    result: list[list[Module]] = []

    def visit(node: Module) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            position = stack.index(node)
            if len(stack) - position > 1:
                result.append(sorted(stack[position:]))
            del stack[position:]

    for node in graph:
        if node not in index:
            visit(node)
    return result
