"""Command lines on README and the pages: they parse, their programs are known, the first run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from commands import forked

from docs.generators.pages import blocks
from ergon.cli.app import group
from tests.house.test_docs import PAGES

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
# Programs beside ergon, and what a page has to say so that a reader knows what they need.
NEEDS = {
    "apt": "Debian",
    "csound": "Csound",
    "faust": "Faust",
    "faust2jaqt": "Faust",
    "make": "",  # its targets are looked up
    "man": "manual page",
    "pip": "wheel",
    "pipx": "wheel",
    "python": "",
    "python3": "venv",
    "rustup": "Rust",
    "uvx": "wheel",
    "cp": "",
    ".": "",
    "eval": "",
}
_PLACEHOLDERS = re.compile(r"[\[\]…<>|]|\b(?:OPTIONS|ARGS)\b")


def shell_lines(page: Path) -> Iterator[tuple[str, list[str]]]:
    """The words of each command of the sh blocks of a page, with its place."""
    for block in blocks(page):
        if block.language == "sh":
            for line in block.text.splitlines():
                for command in re.split(r" && | \| ", line.partition(" #")[0]):
                    if command.strip():
                        yield f"{block.where}: {command}", shlex.split(command)


def spans(page: Path) -> Iterator[str]:
    """Commands of ergon in the prose of a page, as `ergon …`."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for span in re.findall(r"`(ergon [a-z][^`]*)`", text):
        line = " ".join(span.split())
        if not _PLACEHOLDERS.search(line):
            yield line


def parse(words: list[str]) -> None:
    """Parse options and arguments, without looking at files. Raises click.UsageError."""
    context = click.Context(group, info_name="ergon", **group.context_settings)
    command: click.Command = group
    rest = words
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        name, inner, rest = command.resolve_command(context, [*rest])  # a group may have a default
        assert inner is not None
        context = click.Context(inner, parent=context, info_name=name)
        command = inner
    command.make_parser(context).parse_args([*rest])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page_sh_block_commands_parse(page: Path):
    text = page.read_text(encoding="utf-8")
    for where, words in shell_lines(page):
        program = Path(words[0]).name if words[0] != "." else "."
        if program == "ergon":
            parse(words[1:])
        else:
            assert program in NEEDS, where
            assert NEEDS[program] in text, f"{where}: the page says nothing of {NEEDS[program]}"
        if program == "make":
            assert words[1] in TARGETS, where


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_page_prose_commands_parse(page: Path):
    for line in spans(page):
        try:
            parse(shlex.split(line.replace("DEVICE", "emul:"))[1:])
        except click.BadOptionUsage:
            continue  # prose names an option without its value
        except (click.UsageError, ValueError) as error:
            pytest.fail(f"{page.name}: `{line}`: {error}")


@pytest.mark.parametrize(
    "line", ["ergon rendr a.yaml", "ergon render --ouput a.wav", "ergon view -z"]
)
def test_parse_of_unknown_command(line: str):
    with pytest.raises(click.UsageError):
        parse(line.split()[1:])


def test_first_commands_of_readme(tmp_path: Path):
    """In an empty folder, in their order; tests/cli/test_cli_view.py runs the view."""
    typed = [words[1:] for _, words in shell_lines(ROOT / "README.md") if words[0] == "ergon"]
    assert [words[0] for words in typed] == ["demo", "view", "new", "help"]
    for words in typed:
        if words[0] == "view":
            continue
        silent = ["--no-audio"] if words[0] == "demo" else []
        done = forked([*words, *silent], tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "one-gesture.wav").stat().st_size > 1_000_000
    assert (tmp_path / "mine" / "score.yaml").is_file()
    for words in (["check", "score.yaml"], ["render", "score.yaml"]):
        assert forked(words, tmp_path / "mine").returncode == 0
    assert re.search(r"ergon repl score.yaml", (tmp_path / "mine" / "README.md").read_text())
