"""Errors are data: no code of the product looks for words in the message of one."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# Four rooms are links, which `rglob` does not follow.
FILES = [path for room in (ROOT / "ergon").iterdir() for path in room.resolve().rglob("*.py")]
SEARCHES = {"search", "match", "fullmatch", "findall", "finditer", "sub", "split"}
METHODS = {
    *("partition", "rpartition", "removeprefix", "removesuffix", "startswith", "endswith", "find"),
    *("rfind", "index", "rindex", "count", "replace", "translate", "split", "rsplit"),
}
# PyYAML gives a mistake as a sentence alone, which is turned into one that a composer can use.
ALLOWED = {("ergon/notation/text/syntax.py", "explained")}


def is_message(node: ast.AST, names: set[str]) -> bool:
    """Whether an expression is the message of an error: `error.message`, `str(error)`, or a name
    for one.
    """
    match node:
        case ast.Attribute(attr="message" | "sentence"):
            return True
        case ast.Call(func=ast.Name("str"), args=[ast.Name(name)]):
            return f"{name}()" in names
        case ast.Name(name):
            return name in names
    return False


def names_of_messages(nodes: list[ast.AST]) -> set[str]:
    """Names of messages, and of errors as `name()`, in the nodes of a function."""
    names = {"error()"} | {
        f"{node.name}()" for node in nodes if isinstance(node, ast.ExceptHandler)
    }
    for node in nodes:
        if isinstance(node, ast.Assign) and is_message(node.value, names):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def searches(function: ast.AST) -> Iterator[str]:
    """Expressions that look for words in a message."""
    nodes = list(ast.walk(function))
    names = names_of_messages(nodes)
    for node in nodes:
        if not isinstance(node, ast.Call | ast.Compare):
            continue
        match node:
            case ast.Call(func=ast.Attribute(value, method)):  # `split()` alone joins lines
                inside = method in METHODS and node.args and is_message(value, names)
                by_pattern = method in SEARCHES and any(
                    is_message(argument, names) for argument in node.args
                )
                if inside or by_pattern:
                    yield ast.unparse(node)
            case ast.Compare(ops=[ast.In() | ast.NotIn()], comparators=[words]):
                if is_message(words, names):
                    yield ast.unparse(node)


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def test_product_code_without_message_searches():
    assert len(FILES) > 400
    matching = {
        (path.relative_to(ROOT).as_posix(), function.name): text
        for path in FILES
        for function in functions(path)
        for text in searches(function)
    }
    assert matching.keys() == ALLOWED, matching


@pytest.mark.parametrize(
    "line",
    [
        "error.message.removeprefix('point: ')",
        "str(error).split(':')",
        "re.search(r'point (\\d+)', str(caught))",
        "'frame' in caught.message",
        "words.partition(';')",
    ],
)
def test_message_searches_detected_in_examples(line: str):
    function = ast.parse(
        f"def f():\n try:\n  g()\n except E as caught:\n  words = str(caught)\n  {line}\n"
    )
    assert list(searches(function))
