"""Late ticks of a performance by the wall clock: without pointers, with two of light pages, and
with two of a page in Chromium.

Light pages (`light_pages`) send what a page sends and draw nothing. So they show what the pointers
cost the thread of the keys; Chromium shows what a browser beside it costs the machine.

The machine's own lateness drifts for minutes. So the kinds take turns, each round in the opposite
order of the last, and a bare loop beside each run shows how late the machine alone was.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benches.beside import Bare, bare
from benches.measure import Row
from benches.native import Loops
from ergon.api.play import PlayOptions, begin, prepare
from ergon.common.report import Report
from ergon.workshop.movies.chromium import Page, launch_browser

_TARGET = 0.0002  # of all ticks, more than without pointers
_AHEAD = 4096  # frames kept ready, as docs/view.md advises with pages
_WAIT = 20.0  # [s] for a page to be there
_ROUNDS = 4
_SOURCES = Path(__file__).parents[1]
_SCORE = """\
ergon: 1
keys: {k1: {M: 50g, K: 60N/m, Z: 1Ns/m, travel: -15mm..15mm}, k2: {like: k1}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 440Hz, t60: 2.5s}}
      a: {BUT: {between: [k1, m], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}
      b: {BUT: {between: [k2, m], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
players: {ada: {hand: live, key: k1}, remi: {hand: live, key: k2}}
mix: {route: [{from: bell, to: 1}]}
render: {tail: 900s}
"""


@dataclass
class _Run:
    """The result of one performance: ticks, those that were late, and positions of pointers."""

    ticks: int
    late: int
    positions: int
    beside: Bare | None


# Moves the pointers of a piece at an address, whose clock is so far ahead of ours [s], for so long
# [s].
_Mover = Callable[[str, float, float], None]


def pointers(loops: Loops | None, minutes: float = 1.0) -> list[Row]:
    """Late ticks in `minutes` minutes of each kind: without pointers, and with two."""
    seconds = 60.0 * minutes / _ROUNDS
    with _movers() as movers:
        runs: dict[str, list[_Run]] = {kind: [] for kind in movers}
        for turn in range(_ROUNDS):
            for kind in list(movers)[:: -1 if turn % 2 else 1]:
                runs[kind].append(_played(movers[kind], seconds, loops))
    return [_row(kind, runs[""], played, seconds) for kind, played in runs.items() if kind]


def _row(kind: str, plain: list[_Run], played: list[_Run], seconds: float) -> Row:
    without, beside = (
        sum(run.late for run in some) / sum(run.ticks for run in some) for some in (plain, played)
    )
    bares = (
        ", ".join(f"{run.beside.late:.3%}" for run in some if run.beside) or "no bare loop"
        for some in (plain, played)
    )
    positions = sum(run.positions for run in played)
    assert positions > 2, "no pointer played"
    return Row(
        f"two keys at 1,002 Hz, {_AHEAD:,} frames kept ready, without pointers and with two of "
        f"{kind}, {len(played)} × {seconds:.0f} s each",
        f"{without:.3%} of ticks late without, {beside:.3%} with ({beside - without:+.3%}); "
        f"{positions / (len(played) * seconds):.0f} positions a second",
        f"bare loops beside them: {next(bares)} without, {next(bares)} with; "
        f"target: {_TARGET:+.2%} at most",
        None,
        "by the clock",
        {"late_without": without, "late_with": beside, "positions": positions},
    )


@contextlib.contextmanager
def _movers() -> Iterator[dict[str, _Mover]]:
    """What moves the pointers, by its name; Chromium only where there is one."""
    movers: dict[str, _Mover] = {
        "": lambda _url, _offset, seconds: time.sleep(seconds),
        "light pages": _move_lightly,
    }
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), "")
    if not program:
        yield movers
        return
    with launch_browser(program, ("--use-angle=swiftshader",)) as browser:

        def in_browser(url: str, _offset: float, seconds: float) -> None:
            with browser.page(420, 520) as page:
                _open(page, url)
                _move(page, seconds)

        yield movers | {"a page in Chromium": in_browser}


def _move_lightly(url: str, offset: float, seconds: float) -> None:
    """Two light pages in another process."""
    words = [sys.executable, "-m", "benches.light_pages", url, str(offset), str(seconds)]
    subprocess.run(words, cwd=_SOURCES, check=True, stdout=subprocess.DEVNULL)


@contextlib.contextmanager
def _in_a_folder() -> Iterator[None]:
    """Work in an empty folder."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


def _played(mover: _Mover, seconds: float, loops: Loops | None) -> _Run:
    with _in_a_folder():
        Path("s.yaml").write_text(_SCORE)
        live = ["ada=page:", "remi=page:"]
        options = PlayOptions(live=live, audio="null,block=256", gain="0dB", ahead=_AHEAD)
        ready = prepare("s.yaml", options, Report())
        performance = begin(ready.stage, ready.config, Report())
        leads = [board.pointer for board in ready.hands.boards if board.pointer]
        try:
            assert ready.config.pages is not None
            before = performance.status()
            with bare(loops) as beside:
                offset = leads[0].now() - time.monotonic()
                mover(ready.config.pages.server.url, offset, seconds)
                after = performance.status()
        finally:
            performance.stop()
            performance.close(10.0)
            tallies = [lead.tally for lead in leads]
            ready.close()
        positions = sum(int(tally["taken"]) for tally in tallies)
        return _Run(after.ticks - before.ticks, after.late - before.late, positions, beside)


def _open(page: Page, url: str) -> None:
    page.call("Page.bringToFront")
    page.call("Page.navigate", url=f"{url}hands.html")
    page.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    end = time.monotonic() + _WAIT
    lanes = "document.querySelectorAll('#hands canvas').length"
    while page.run(lanes) != 2:
        assert time.monotonic() < end, "the page has no lanes"
        time.sleep(0.1)


def _move(page: Page, seconds: float) -> None:
    """Move two touches to and fro for a while."""
    middles = []
    for lane in range(2):
        canvas = f"document.querySelectorAll('#hands canvas')[{lane}]"
        box = page.run(f"{canvas}.getBoundingClientRect().toJSON()")
        middles.append((box["x"] + box["width"] / 2, box["y"] + box["height"] / 2))
    start, kind = time.monotonic(), "touchStart"
    while (t := time.monotonic() - start) < seconds:
        points = [
            {"id": lane, "x": x, "y": y - 90.0 * math.sin(2.0 * math.pi * (0.7 + lane) * t)}
            for lane, (x, y) in enumerate(middles)
        ]
        page.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        kind = "touchMove"
