"""Names of code on the pages for developers exist: a page that names what was renamed misleads."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "DESIGN.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs" / "design").glob("*.md")),
]
CODE_FOLDERS = ("benches", "cli", "core-rs", "docs", "editors", "ergon", "instruments", "repl")
CODE_FILES = "*.[pr][ys]", "*.pyi", "*.toml", "*.js", "*.yaml", "*.txt"
_SPAN = re.compile(r"`([^`\n]+)`")
# `Curve`, `_add_link`, `Profile::push_run`; no part of a path, an option or a name with a point.
_NAME = re.compile(r"(?<![\w/.-])[A-Za-z_]\w*(?:::\w+)*(?![\w/-]|\.[a-z])")


@pytest.fixture(scope="module")
def code_texts() -> dict[Path, str]:
    """The text of each file of code, without this one."""
    folders = [ROOT / name for name in (*CODE_FOLDERS, "scores", "tests")]
    paths = {path for folder in folders for kind in CODE_FILES for path in folder.rglob(kind)}
    paths |= {*ROOT.glob("*.toml"), ROOT / "Makefile"}
    return {
        path: path.read_text(encoding="utf-8", errors="replace")
        for path in sorted(paths - {Path(__file__)})
        if path.is_file() and not {"target", "node_modules"} & set(path.parts)
    }


@pytest.fixture(scope="module")
def code_words(code_texts: dict[Path, str]) -> set[str]:
    return {word for text in code_texts.values() for word in re.findall(r"\w+", text)}


def names_on(page_text: str) -> set[str]:
    """Names in code style that can only be of code: with a capital, an underscore or a `::`."""
    names = {name for span in _SPAN.findall(page_text) for name in _NAME.findall(span)}
    return {name for name in names if re.search(r"[A-Z_]|::", name)}


def is_defined(path_name: str, code_texts: dict[Path, str]) -> bool:
    """Whether a Rust file that defines `Type`, or is the module, defines the last part of
    `Type::name`.
    """
    *_, type_name, name = path_name.split("::")
    definition = re.compile(
        rf"\b(fn|const|struct|enum|type|mod) {name}\b|^\s*(pub )?{name}\b\s*[,:({{]", re.MULTILINE
    )
    owner = re.compile(rf"\b(struct|enum|trait|type|impl[^\n{{]*|mod) {type_name}\b")
    return any(
        definition.search(text) and (path.stem == type_name or owner.search(text))
        for path, text in code_texts.items()
        if path.suffix == ".rs"
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_of_code_exist(page: Path, code_texts: dict[Path, str], code_words: set[str]) -> None:
    names = names_on(page.read_text(encoding="utf-8"))
    missing = [
        name
        for name in sorted(names)
        if not (is_defined(name, code_texts) if "::" in name else name in code_words)
    ]
    assert not missing, f"{page.name} names what is not in the code: {missing}"


def test_renamed_method_is_missing() -> None:
    texts = {Path("a.rs"): "impl Profile {\n    fn push_run(&self) {}\n}\n"}
    assert is_defined("Profile::push_run", texts)
    assert not is_defined("Profile::run", texts)
    assert names_on("`Profile::run` of `a/b.rs`, `_add_link` and `word`") == {
        "Profile::run",
        "_add_link",
    }
