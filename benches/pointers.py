"""Late ticks of a performance by the wall clock, without and with two pointers of a page.

The machine's own lateness drifts for minutes. So each kind is played twice, the runs without
pointers first and last, and a bare loop beside each shows how late the machine alone was.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
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


def pointers(loops: Loops | None, minutes: float = 1.0) -> list[Row]:
    """Late ticks in `minutes` minutes without pointers, and in as many with two."""
    seconds = 30.0 * minutes
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), "")
    if not program:
        return []
    with launch_browser(program, ("--use-angle=swiftshader",)) as browser:
        runs = []
        for has_pointers in (False, True, True, False):
            with browser.page(420, 520) as page:
                runs.append(_played(page if has_pointers else None, seconds, loops))
    plain, played = (runs[0], runs[3]), (runs[1], runs[2])
    without, beside = (
        sum(run.late for run in some) / sum(run.ticks for run in some) for some in (plain, played)
    )
    bares = [run.beside for run in runs if run.beside]
    reference = ", ".join(f"{own.late:.3%}" for own in bares) or "no bare loop"
    positions = sum(run.positions for run in played)
    return [
        Row(
            f"two keys at 1,002 Hz, {_AHEAD:,} frames kept ready, without pointers and with two of "
            f"a page in Chromium, 2 × {seconds:.0f} s each",
            f"{without:.3%} of ticks late without, {beside:.3%} with ({beside - without:+.3%}); "
            f"{positions / (2 * seconds):.0f} positions a second",
            f"a bare loop beside them: {reference}; target: {_TARGET:+.2%} at most",
            None,
            "by the clock",
            {"late_without": without, "late_with": beside, "positions": positions},
        )
    ]


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


def _played(page: Page | None, seconds: float, loops: Loops | None) -> _Run:
    with _in_a_folder():
        Path("s.yaml").write_text(_SCORE)
        live = ["ada=page:", "remi=page:"]
        options = PlayOptions(live=live, audio="null,block=256", gain="0dB", ahead=_AHEAD)
        ready = prepare("s.yaml", options, Report())
        performance = begin(ready.stage, ready.config, Report())
        try:
            if page is not None:
                assert ready.config.pages is not None
                _open(page, ready.config.pages.server.url)
            before = performance.status()
            with bare(loops) as beside:
                _move(page, seconds)
                after = performance.status()
        finally:
            performance.stop()
            performance.close(10.0)
            tallies = [board.lead.tally for board in ready.hands.boards if board.lead]
            ready.close()
        positions = sum(int(tally["taken"]) for tally in tallies)
        assert page is None or positions > 2, "no pointer played"
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


def _move(page: Page | None, seconds: float) -> None:
    """Move two touches to and fro for a while, or wait."""
    if page is None:
        time.sleep(seconds)
        return
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
