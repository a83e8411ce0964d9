"""Manual pages of all commands, from the table that `--help` is made of.

python -m docs.generators.man out/man
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from ergon.api.version import __version__
from ergon.cli.app import EXIT_CODES, group
from ergon.cli.examples import EXAMPLES
from ergon.cli.lazy import LazyGroup
from ergon.common.module_arguments import module_arguments


def pages() -> dict[str, str]:
    """The text of each page by its file: `ergon.1`, `ergon-render.1`, `ergon-take-trim.1`."""
    return {
        f"{'-'.join(words)}.1": "\n".join(_page(words, command)) + "\n"
        for words, command in commands(("ergon",), group)
    }


def commands(
    words: tuple[str, ...], command: click.Command
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """A command and all below it, each with its words."""
    yield words, command
    if isinstance(command, LazyGroup):
        context = click.Context(command, **group.context_settings)
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from commands((*words, name), inner)


def _page(words: tuple[str, ...], command: click.Command) -> Iterator[str]:
    context = click.Context(command, info_name=" ".join(words), **group.context_settings)
    what, _, more = (command.help or "").partition("\n\n")
    yield f'.TH "{"-".join(words).upper()}" 1 "" "ergon {__version__}" "ergon"'
    yield ".SH NAME"
    yield f"{_text('-'.join(words))} \\- {_text(what).rstrip('.')}"
    yield ".SH SYNOPSIS"
    pieces = " ".join(command.collect_usage_pieces(context))
    yield f".B {' '.join(words)}"
    yield _text(pieces)
    if more:
        yield ".SH DESCRIPTION"
        yield from _paragraphs(more)
    options = [
        record for p in command.get_params(context) if (record := p.get_help_record(context))
    ]
    if options:
        yield ".SH OPTIONS"
        for name, meaning in options:
            yield from (".TP", f".B {_text(name)}", _text(meaning) or "\\&")
    if isinstance(command, LazyGroup):
        yield ".SH COMMANDS"
        for title, names in command.sections.items():
            yield f".SS {title}"
            for name in names:
                inner = command.get_command(context, name)
                short = "" if inner is None else inner.get_short_help_str(200)
                yield from (".TP", f".B {name}", _text(short))
    rows = EXAMPLES.get(" ".join(words[1:]), ())
    if rows:
        yield ".SH EXAMPLES"
        for line, meaning in rows:
            yield from (".TP", f".B {_text(line)}", _text(meaning) or "\\&")
    yield ".SH EXIT STATUS"
    for code, meaning in EXIT_CODES:
        yield from (".TP", f".B {code}", _text(str(meaning)))
    yield ".SH SEE ALSO"
    yield "\\fBergon help\\fR \\fITOPIC\\fR shows pages of the manual."


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in text.split("\n\n"):
        yield ".PP"
        yield _text(paragraph.replace("\b", ""))


def _text(text: str) -> str:
    """One line of roff that prints as the text."""
    line = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{line}" if line.startswith((".", "'")) else line


def main(folder: Path) -> None:
    """Write all pages into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    written = pages()
    for name, text in written.items():
        (folder / name).write_text(text, encoding="utf-8")
    print(f"{folder}: {len(written)} pages")


if __name__ == "__main__":
    main(Path(module_arguments("FOLDER")[0]))
