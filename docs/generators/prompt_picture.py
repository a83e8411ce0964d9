"""The still of the prompt on README.md: a session in a terminal of 80 columns, as SVG.

PYTHONPATH=tests/support python -m docs.generators.prompt_picture docs/pictures/prompt.svg
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.sax.saxutils import escape

from terminals import ENTER, Terminal

from docs.generators.pages import blocks, put
from ergon.common.module_arguments import module_arguments

README = Path(__file__).resolve().parents[2] / "README.md"
ROWS, COLUMNS = 20, 80
LINES = (
    "play",
    "knock = 0@0 smooth 7@30ms 0@60ms",
    "ada plyas knock every 1/2",
    "ada plays knock every 1/2",
    "ada do mirror, scale 1.2",
    "tempo 72",
    "undo",
)
_ANSWERS = ("      ok", "      not taken")
_WIDE, _HIGH, _EDGE = 8.4, 18.0, 14.0  # pixels of a letter, a line, and around them
_INK, _PAPER = "#d8dee9", "#1b1f2a"
_COLOURS = {
    "default": _INK,
    "black": "#7b8496",
    "red": "#f0717a",
    "green": "#8fd08a",
    "brown": "#e6c674",
    "blue": "#79a8f0",
    "magenta": "#cf9be6",
    "cyan": "#74cfd6",
    "white": "#ffffff",
    "brightblack": "#7b8496",
}


def rows_of(terminal: Terminal) -> list[list[tuple[str, str, bool]]]:
    """Each row of the screen as runs of text: the text, its colour, and whether it is bold."""
    rows = []
    for number in range(ROWS):
        cells = terminal.screen.buffer[number]
        row = [cells[column] for column in range(COLUMNS)]
        runs = groupby(row, key=lambda cell: (cell.fg, cell.bold))
        rows.append([("".join(c.data for c in run), fg, bold) for (fg, bold), run in runs])
    return rows


def svg(rows: list[list[tuple[str, str, bool]]]) -> str:
    """The screen as a picture."""
    width, height = COLUMNS * _WIDE + 2 * _EDGE, len(rows) * _HIGH + 2 * _EDGE
    body = "\n".join(line for number, row in enumerate(rows) for line in _row(number, row))
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{width:g}' height='{height:g}' "
        f"viewBox='0 0 {width:g} {height:g}' role='img' aria-label='The prompt of ergon repl' "
        "font-family='ui-monospace, DejaVu Sans Mono, Menlo, Consolas, monospace' "
        "font-size='14'>\n"
        f"<rect width='100%' height='100%' rx='8' fill='{_PAPER}'/>\n{body}\n</svg>\n"
    )


def _row(number: int, runs: list[tuple[str, str, bool]]) -> Iterator[str]:
    column = 0
    for text, colour, is_bold in runs:
        if text.strip():
            x, y = _EDGE + column * _WIDE, _EDGE + (number + 0.75) * _HIGH
            fill = _COLOURS.get(colour, f"#{colour}" if len(colour) == 6 else _INK)
            weight = " font-weight='bold'" if is_bold else ""
            length = len(text.rstrip()) * _WIDE
            yield (
                f"<text x='{x:g}' y='{y:g}' fill='{fill}'{weight} xml:space='preserve' "
                f"textLength='{length:g}'>{escape(text.rstrip())}</text>"
            )
        column += len(text)


def _has_answered(terminal: Terminal, count: int) -> bool:
    answers = [line for line in terminal.text.split("\n") if line.startswith(_ANSWERS)]
    return len(answers) >= count


def main(target: Path) -> None:
    """Type the lines, and draw the screen."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        for block in blocks(README):
            if block.language == "yaml":
                put(block, folder)
        environment: dict[str, Any] = {"HOME": name, "XDG_CACHE_HOME": str(folder / "cache")}
        command = [sys.executable, "-m", "ergon", "repl", "first.yaml", "--audio", "null"]
        with Terminal(command, ROWS, COLUMNS, folder, **environment) as terminal:
            terminal.sees("1|1 >")
            for number, line in enumerate(LINES, 1):
                terminal.type(line + ENTER)
                terminal.until(partial(_has_answered, terminal, number), f"an answer to {line!r}")
            terminal.until(lambda: terminal.cursor_line.endswith(">"), "a prompt")
            picture = svg(rows_of(terminal))
    target.write_text(picture, encoding="utf-8")


if __name__ == "__main__":
    main(Path(module_arguments("FILE")[0]))
