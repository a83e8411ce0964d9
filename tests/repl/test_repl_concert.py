"""The session that docs/repl.md shows, typed in a real terminal, and what is left of it.

The piece is computed up to each line's bar and then stands still, so no line is typed too late.
"""

import os
import re
import sys
from pathlib import Path

import pytest
import soundfile
from commands import ERGON
from terminals import ENTER, Terminal

from ergon.exchange.wave import read_info

PAGE = Path(__file__).parents[2] / "docs" / "repl.md"
SESSION = Path(__file__).parents[1] / "support" / "stepped_session.py"
BLOCK = re.compile(
    r"<!-- session: ergon (?P<command>[^\n]*) -->\n```repl\n(?P<text>.*?)```", re.DOTALL
)
LINE = re.compile(r"(?P<bar>\d+)\|\d+ (?:> )?(?P<line>.+)")


def exchanges(text: str) -> list[tuple[int, str, list[str]]]:
    """(bar, line, answers) of every line that is typed; `# …` is what happens beside the prompt."""
    result: list[tuple[int, str, list[str]]] = []
    for row in text.splitlines():
        if match := LINE.fullmatch(row):
            result.append((int(match["bar"]), match["line"], []))
        else:
            result[-1][2].append(row.strip())
    return result


def shown(answer: str) -> re.Pattern[str]:
    return re.compile(".*".join(map(re.escape, answer.split("…"))))


@pytest.mark.slow
def test_concert_of_repl_page_in_real_terminal(tmp_path: Path):
    page = PAGE.read_text(encoding="utf-8")
    score = re.search(r"<!-- file: concert.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
    session = BLOCK.search(page)
    assert score is not None
    assert session is not None
    (tmp_path / "concert.yaml").write_text(score[1], encoding="utf-8")
    typed = exchanges(session["text"])
    assert len(typed) >= 20
    assert session["command"].split()[:2] == ["repl", "concert.yaml"]
    pipe = tmp_path / "bars"
    os.mkfifo(pipe)
    command = [sys.executable, str(SESSION), str(tmp_path / "concert.yaml"), str(pipe)]
    with Terminal(command, rows=50, columns=120, HOME=str(tmp_path)) as terminal:
        terminal.sees("1|1 >")
        with pipe.open("w", encoding="ascii") as bars:
            for bar, line, answers in typed:
                print(bar, file=bars, flush=True)
                terminal.until(lambda bar=bar: bar_of(terminal) >= bar, f"bar {bar}")
                terminal.type(line + ENTER)
                for answer in answers:
                    wanted = shown(answer)
                    terminal.until(
                        lambda wanted=wanted, line=line: wanted.search(after(terminal, line)),
                        f"{answer!r} after {line!r}",
                    )
        assert terminal.ends() == 0
    rendered = Terminal(
        [*ERGON, "render", str(tmp_path / "session.jsonl"), "-o", str(tmp_path / "concert.wav")]
    )
    with rendered:
        assert rendered.ends() == 0
    sound, _ = soundfile.read(tmp_path / "concert.wav", always_2d=True)
    # Positions in metres at a gain of 1: a struck bell moves by about 1 mm.
    assert abs(sound).max(axis=0).min() > 5e-4, "both instruments are heard"
    assert read_info(tmp_path / "concert.wav").format.n_channels == 2
    saved = (tmp_path / "concert-live.yaml").read_text(encoding="utf-8")
    for comment in ("# rings for a second", "# a bar of four"):
        assert comment in saved
    files = [str(tmp_path / name) for name in ("concert-live.yaml", "verse-2.yaml")]
    with Terminal([*ERGON, "check", *files]) as check:
        assert check.ends() == 0


def after(terminal: Terminal, line: str) -> str:
    """What stands below the latest time that a line was typed."""
    return terminal.text.rpartition(f"> {line}")[2]


def bar_of(terminal: Terminal) -> int:
    """The bar in the prompt."""
    match = re.match(r"(\d+)\|\d+ >", terminal.cursor_line)
    return int(match[1]) if match else 0
