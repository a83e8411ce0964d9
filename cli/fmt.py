"""`ergon fmt`: the common layout of scores."""

from __future__ import annotations

import difflib
import re
import sys
from pathlib import Path

import click

from ergon.common.regular import read_bounded

from . import options
from .bundled import is_pack
from .console import Console, plural
from .outcome import Findings, Refused

# Instruments and scenes, which scores use, have it too.
_SCORE_LINE = re.compile(r"^\ufeff?[\"']?ergon[\"']?\s*:", re.MULTILINE)


@click.command()
@click.argument("scores", metavar="SCORE...", nargs=-1, required=True)
@click.option(
    "--check",
    "only_check",
    is_flag=True,
    help="Change nothing; exit with code 1 where a score would change.",
)
@click.option("--diff", is_flag=True, help="Print what would change; change nothing.")
@options.with_console
def fmt(console: Console, scores: tuple[str, ...], only_check: bool, diff: bool) -> None:
    """Put the layout of scores in order; comments stay.

    Spaces inside braces, columns of tables and the ends of lines are put in order; comments and
    what a score means never change. `-` formats stdin to stdout.
    """
    n_changed = 0
    for path in scores:
        n_changed += _format(console, path, only_check, diff)
    if (only_check or diff) and n_changed:
        raise Findings(f"{plural(n_changed, 'score')} would change" if only_check else "")


def _format(console: Console, path: str, only_check: bool, diff: bool) -> bool:
    from ergon.exchange.safe import open_for_writing
    from ergon.notation.text.errors import TextError
    from ergon.notation.text.format import formatted
    from ergon.notation.text.syntax import MAX_BYTES

    if is_pack(path):
        raise Refused(f"{path}: a pack is not changed; `ergon unpack {path}` writes its files")
    is_stdin = path == "-"
    size_limit = MAX_BYTES + 1
    source_bytes = (
        sys.stdin.buffer.read(size_limit) if is_stdin else read_bounded(Path(path), MAX_BYTES)
    )
    if len(source_bytes) > MAX_BYTES:
        raise Refused(
            f"{path}: the file is larger than {MAX_BYTES >> 20} MB, the most that a score may have"
        )
    try:
        text_before = source_bytes.decode("utf-8")
        formatted_text = formatted(text_before)
    except UnicodeDecodeError:
        raise Refused(f"{path}: the file is not text in UTF-8") from None
    except TextError as error:
        error_line = text_before.count("\n", 0, error.offset) + 1
        column = error.offset - (text_before.rfind("\n", 0, error.offset) + 1) + 1
        place = {"file": path, "line": error_line, "column": column}
        message = f"{path}:{error_line}:{column}: {error.message}"
        raise Findings(message, code=error.code, **place) from None
    if not _SCORE_LINE.search(text_before):
        raise Refused(
            f"{path}: this is not a score, because no line of it begins with `ergon:`; nothing was "
            "changed"
        )
    is_changed: bool = formatted_text != text_before
    if diff:
        diff_lines = difflib.unified_diff(
            text_before.splitlines(keepends=True),
            formatted_text.splitlines(keepends=True),
            path,
            path,
        )
        _print("".join(diff_lines))
    elif path == "-" and not only_check:
        _print(formatted_text)
    elif is_changed and not only_check:
        # The composer asks for this, and the score stays the composer's own file.
        with open_for_writing(path, binary=False, force=True, replaceable=False) as file:
            file.write(formatted_text.encode())
    if console.json:
        console.record("fmt", file=path, changed=is_changed)
    elif is_changed and not diff and path != "-":
        console.say(f"{path}: " + ("would change" if only_check else "laid out"))
    return is_changed


def _print(shown_text: str) -> None:
    """Write to stdout byte by byte; on a terminal, without characters that steer it."""
    from ergon.exchange.safe import write_text

    write_text("-", shown_text)
