"""A score as the commands meet it: read, staged, and asked for what they print.

Everything that the command line knows about a Piece stands here.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ergon.exchange.wave_header import Bits
from ergon.rendering.level import Level

from .console import Console, plural
from .outcome import Findings, Refused

if TYPE_CHECKING:
    from ergon.notation.text.bounds import Bounds
    from ergon.notation.text.errors import Diagnostic, Severity
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Accuracy, Piece
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Pins
    from ergon.scores.staging.stage import Stage

STDIN = "-"


@dataclass(frozen=True, slots=True)
class Plan:
    """How exact the command line wants it, instead of as the score says."""

    method: str | None = None
    error: str | None = None
    cents: float | None = None
    pinned: str | None = None

    def accuracy(self, of_score: Accuracy) -> Accuracy:
        """What is wanted of a piece."""
        from ergon.notation.tables.quantities import ERROR, quantity
        from ergon.notation.text.errors import TextError
        from ergon.notation.text.spelling import nearest
        from ergon.scores.reading.piece import METHODS
        from ergon.scores.staging.planning import wished

        if sum(value is not None for value in (self.method, self.error, self.cents)) > 1:
            raise Refused("--method, --error and --cents: one of them")
        if self.method is not None and self.method not in METHODS:
            close = nearest(self.method, METHODS)
            asked = f"; did you mean '{close}'?" if close else f": {', '.join(METHODS)}"
            raise Refused(f"--method: there is no '{self.method}'{asked}")
        try:
            error = None if self.error is None else quantity(self.error, ERROR)
        except TextError as found:
            raise Refused(f"--error: {found.message}") from None
        return wished(of_score, method=self.method, error=error, cents=self.cents)

    @property
    def read(self) -> tuple[Path, ...]:
        """The file of the earlier plan."""
        return () if self.pinned is None else (Path(self.pinned),)

    def pins(self) -> Pins | None:
        """What an earlier plan decided, if one is to be followed."""
        from ergon.exchange.plan_file import NotPlanError, read

        if self.pinned is None:
            return None
        try:
            return read(Path(self.pinned))
        except NotPlanError as error:
            raise Refused(f"{self.pinned}: {error}") from None


@dataclass(frozen=True, slots=True)
class Staged:
    """A piece ready to run, and how long it took to prepare [s]."""

    piece: Piece
    stage: Stage
    plan_s: float


def read(
    console: Console, path: str, *, leave_out: Sequence[str] = (), trust: bool = False
) -> Loaded:
    """Load a score and print its diagnostics, but for some codes; `-` is stdin.

    With `trust` it may name files outside its folder.
    """
    from ergon.scores.reading.load import load

    text = _stdin() if path == STDIN else None
    loaded = load(path, text=text, bounds=bounds(path, trust))
    loaded = replace(
        loaded, diagnostics=[one for one in loaded.diagnostics if one.code not in leave_out]
    )
    console.diagnostics(loaded.diagnostics, loaded.files, loaded.left_out)
    return loaded


def bounds(path: str, trust: bool) -> Bounds:
    """Where the files of a score may lie."""
    from ergon.notation.text.bounds import Bounds

    return Bounds.around(Path(path).parent, trust=trust)


def piece_of(loaded: Loaded) -> Piece:
    """The piece, or Findings when the score has errors (they are printed already)."""
    if loaded.piece is None:
        raise Findings
    return loaded.piece


def tally(loaded: Loaded, more: Sequence[Diagnostic] = ()) -> str:
    """`2 errors, 1 warning`, or `no mistakes`; those that were not shown count as well."""
    counts: dict[Severity, int] = {"error": 0, "warning": 0, "note": 0, **loaded.left_out}
    for found in (*loaded.diagnostics, *more):
        counts[found.severity] += 1
    return ", ".join(plural(n, kind) for kind, n in counts.items() if n) or "no mistakes"


def stage_piece(
    console: Console,
    loaded: Loaded,
    *,
    seed: int | None = None,
    rate: float | None = None,
    record: bool = False,
    plan: Plan | None = None,
    threads: int = 1,
    real: Real | None = None,
    silent: Container[str] = (),
    on_fault: Literal["stop", "mute"] = "stop",
) -> Staged:
    """Put the piece on its stage, and print what the engine has to say of it.

    With a `plan` as it says, without one every module is stepped as it is written.
    """
    from ergon.exchange.plan_store import of_user
    from ergon.scores.staging.stage import stage

    piece = piece_of(loaded)
    start = time.perf_counter()
    # Parameters are physical: another rate needs no other score.
    played = piece if rate is None else replace(piece, rate=rate)
    if plan is not None:
        played = replace(played, accuracy=plan.accuracy(played.accuracy))
    pins = None if plan is None else plan.pins()
    with staging(console, lambda: loaded):
        staged = stage(
            played,
            seed=seed,
            record=record,
            planned=plan is not None,
            pins=pins,
            store=of_user(),
            threads=threads,
            real=real,
            silent=silent,
            on_fault=on_fault,
        )
    plan_s = time.perf_counter() - start
    show(console, loaded, staged.diagnostics)
    return Staged(piece, staged, plan_s)


def show(console: Console, loaded: Loaded, found: Sequence[Diagnostic]) -> None:
    """Print diagnostics that come after loading."""
    console.diagnostics(found, loaded.files, {})


@contextmanager
def staging(console: Console, loaded: Callable[[], Loaded]) -> Iterator[None]:
    """What the engine will not play is printed in its place, and is Findings."""
    from ergon.scores.staging.stage import StageError

    try:
        yield
    except StageError as error:
        show(console, loaded(), error.diagnostics)
        raise Findings from error


def instant(piece: Piece, text: str, option: str) -> float:
    """Seconds of a position of the piece such as `3|2.5`, `B+2`, `12.5s`."""
    from ergon.notation.clock.positions import parse_position
    from ergon.notation.text.errors import TextError

    tempo = piece.tempo_map
    try:
        return tempo.seconds(tempo.resolve(parse_position(text)))
    except TextError as error:
        asked = f"; did you mean '{error.suggestion}'?" if error.suggestion else ""
        raise Refused(f"{option}: {error.message}{asked}") from None


def where(piece: Piece, seconds: float) -> str:
    """An instant as `bar|beat`."""
    tempo = piece.tempo_map
    return tempo.written(tempo.beats(seconds))


def marks_of(piece: Piece) -> list[tuple[str, float]]:
    """Marks with their beats, in order of time."""
    tempo = piece.tempo_map
    beats = ((mark.name, tempo.resolve(mark.at)) for mark in piece.marks)
    return sorted(beats, key=lambda mark: (mark[1], mark[0]))


def level_of(piece: Piece, bits: Bits) -> Level:
    """What happens between the mix and a file of `bits`."""
    master = piece.mix.master
    if master is None:
        return Level.unsaid(bits)
    return Level.said(bits, normalise=master.normalise, limit=master.limit)


def whole_rate(rate: float) -> int:
    """The rate of a file, which counts whole frames a second."""
    if rate != int(rate):
        raise Refused(f"a WAV file has a whole number of frames per second, not {rate:g}")
    return int(rate)


def _stdin() -> str:
    try:
        return sys.stdin.buffer.read().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise Refused("what comes from stdin is not text in UTF-8") from None
