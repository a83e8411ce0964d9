"""A score as every call uses it: read, staged, and asked for positions and levels."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ergon.common.errors import ErgonError
from ergon.common.foreign_files import foreign_file
from ergon.common.report import Report
from ergon.exchange.wave_header import Bits
from ergon.rendering.level import HIGHPASS_HZ, Level

from .errors import DivergedError, OptionError, ScoreError
from .options import AccuracyOptions, ReadOptions, check_seed

if TYPE_CHECKING:
    from ergon.notation.text.bounds import FileBounds
    from ergon.notation.text.errors import Diagnostic
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.live import RealHands
    from ergon.scores.staging.stage import Stage

STDIN = "-"
JOURNAL_SUFFIX = ".jsonl"  # how the name of a session's journal ends
_SOUND_MESSAGE = (
    "a sound, not a score: `ergon info {path}` says what it holds, `ergon plot {path}` draws it"
)
_UNREAD_SOUND_MESSAGE = (
    "a sound, not a score, and is not read; `ffmpeg -i {path} sound.wav` makes it WAV"
)
# Files that are given where a score is meant, by their endings, and what reads them.
_MESSAGE_BY_SUFFIX = {
    ".wav": _SOUND_MESSAGE,
    ".flac": _SOUND_MESSAGE,
    ".mp3": _UNREAD_SOUND_MESSAGE,
    ".ogg": _UNREAD_SOUND_MESSAGE,
    ".mid": "a MIDI file, not a score: `ergon info {path}` says what is played in it, and a score "
    "plays it by `from: {path}` in a phrase (`ergon help midi`)",
    ".motion": "a file of motion, not a score: `ergon view {path}` shows it",
    ".take": "a take, not a score: `ergon info {path}` says what it holds, and a score plays it by "
    "its section `takes` (`ergon help takes`)",
}


@dataclass(frozen=True, slots=True)
class Staged:
    """A piece ready to run, and how long it took to prepare [s]."""

    piece: Piece
    stage: Stage
    plan_s: float


def read(
    path: str | Path,
    options: ReadOptions | None = None,
    report: Report | None = None,
    *,
    leave_out: Sequence[str] = (),
) -> Loaded:
    """Load a score and report its diagnostics, without the codes in `leave_out`; `-` is stdin."""
    from ergon.scores.reading.load import load

    options, path = options or ReadOptions(), str(path)
    if path.endswith(JOURNAL_SUFFIX):
        raise ErgonError(
            f"{path} is the journal of a session, not a score: `ergon render {path}` computes its "
            f"sound; `ergon repl --resume {path}` continues it, and `save` there writes its score"
        )
    advice = _MESSAGE_BY_SUFFIX.get(Path(path).suffix.lower()) if options.text is None else None
    if advice is not None and Path(path).is_file():
        raise ErgonError(f"{path} is {advice.format(path=path)}")
    text = _read_stdin() if path == STDIN and options.text is None else options.text
    loaded = load(path, text=text, bounds=bounds(path, options.trust))
    if loaded.piece is None and options.text is None:
        _refuse_foreign(Path(path))
    loaded = replace(
        loaded,
        diagnostics=[
            diagnostic for diagnostic in loaded.diagnostics if diagnostic.code not in leave_out
        ],
    )
    (report or Report()).diagnostics(loaded.diagnostics, loaded.files, loaded.left_out)
    return loaded


def _refuse_foreign(path: Path) -> None:
    """Refuse a file of another program; what a reader of scores finds wrong in it helps nobody."""
    foreign_kind = foreign_file(path)
    if foreign_kind is not None and path.suffix.lower() not in (".yaml", ".yml"):
        raise ErgonError(f"{path}: {foreign_kind}")


def bounds(path: str, trust: bool) -> FileBounds:
    """The bounds of the files that a score may name."""
    from ergon.notation.text.bounds import FileBounds

    return FileBounds.around(Path(path).parent, trust=trust)


def piece_of(loaded: Loaded) -> Piece:
    """The piece. Raises ScoreError when the score has errors."""
    if loaded.piece is None:
        raise ScoreError(loaded.diagnostics, loaded.files)
    return loaded.piece


def digest(piece: Piece) -> str:
    """SHA-256 of a piece by its values, whatever its text and comments."""
    from ergon.scores.reading.digest import digest_of

    return digest_of(piece)


def stage_piece(
    loaded: Loaded,
    options: AccuracyOptions | None = None,
    report: Report | None = None,
    *,
    rate: float | None = None,
    threads: int = 1,
    real_hands: RealHands | None = None,
    silent: Container[str] = (),
    on_fault: Literal["stop", "mute"] = "stop",
    is_seen: bool = False,
    recalls_sound: bool = False,
    complete: Piece | None = None,
) -> Staged:
    """Stage a piece, and report the diagnostics of the engine.

    Unused instruments are reported of the `complete` piece, if `loaded` has some of its routes.
    `options` say how it is planned; without them every module is stepped as written, or planned
    if the engine refuses that. With `is_seen` a plan also computes parts that nobody hears.
    Raises ScoreError and OptionError.
    """
    from ergon.exchange import machine_speed
    from ergon.exchange.plan_store import user_store
    from ergon.scores.staging.implausible import warn_implausible
    from ergon.scores.staging.planning import draft_error_sentence
    from ergon.scores.staging.recording_stages import stage_or_plan
    from ergon.scores.staging.stage import stage
    from ergon.scores.staging.unused import warn_unused

    piece = piece_of(loaded)
    start_time = time.perf_counter()
    # Parameters are in physical units: another rate needs no other score.
    piece_at_rate = piece if rate is None else replace(piece, rate=rate)
    stage_function = stage_or_plan
    if options is not None:
        followed_plan = options.followed()
        piece_at_rate = replace(
            piece_at_rate, accuracy=options.accuracy(piece_at_rate.accuracy, followed_plan)
        )
        pinned_choices = followed_plan.choices if followed_plan is not None else None
        correction = machine_speed.read_correction() or 1.0
        stage_function = partial(
            stage,
            planned=True,
            pins=pinned_choices,
            seed=options.seed,
            correction=correction,
            is_draft=options.draft,
            recalls_sound=recalls_sound,
            is_seen=is_seen,
        )
    waiting = (report or Report()).waiting("planning")
    with staging(lambda: loaded, report), waiting:
        stage_result = stage_function(
            piece_at_rate,
            store=user_store(),
            threads=threads,
            real_hands=real_hands,
            silent=silent,
            on_fault=on_fault,
        )
    plan_s = time.perf_counter() - start_time
    if options is not None and options.draft and stage_result.plan is not None:
        (report or Report()).say(
            draft_error_sentence(stage_result.plan)
            if stage_result.is_draft
            else "draft, planned as an earlier render"
        )
    show(
        report,
        loaded,
        [
            *warn_unused(complete or piece),
            *warn_implausible(piece_at_rate),
            *stage_result.diagnostics,
        ],
    )
    return Staged(piece, stage_result, plan_s)


def stage_recording(loaded: Loaded, report: Report, *, seed: int | None = None) -> Stage:
    """A stage whose simulation records its ergons. Raises ScoreError.

    A note says if its rate is a multiple of the score's (`scores.staging.recording_stages`).
    """
    from ergon.exchange.plan_store import user_store
    from ergon.scores.staging.recording_stages import stage_recording

    check_seed(seed)
    piece = piece_of(loaded)
    with staging(lambda: loaded, report):
        staged_recording = stage_recording(piece, seed=seed, store=user_store())
    show(report, loaded, staged_recording.diagnostics)
    if staged_recording.rate != piece.rate:
        report.warn(
            f"the scheme is unstable at {piece.rate:g} Hz; "
            f"the ergons are those of a simulation at {staged_recording.rate:g} Hz"
        )
    return staged_recording


def show(report: Report | None, loaded: Loaded, diagnostics: Sequence[Diagnostic]) -> None:
    """Report diagnostics that come after loading."""
    (report or Report()).diagnostics(diagnostics, loaded.files, {})


@contextmanager
def staging(load_score: Callable[[], Loaded], report: Report | None = None) -> Iterator[None]:
    """Report what the engine refuses, with its place, and raise a ScoreError."""
    from ergon.scores.staging.refusals import StageError

    try:
        yield
    except StageError as error:
        read_score = load_score()
        show(report, read_score, error.diagnostics)
        raise ScoreError(error.diagnostics, read_score.files) from error


@contextmanager
def computing(stage: Stage, loaded: Loaded, report: Report) -> Iterator[None]:
    """Report parts that go non-finite or create energy, with their places. Raises DivergedError."""
    from ergon import _core

    try:
        yield
    except _core.DivergedError as error:
        diagnostics = [stage.fault_diagnostic(error)]
        show(report, loaded, diagnostics)
        raise DivergedError(diagnostics, loaded.files) from error
    if gains := stage.energy_gains():
        show(report, loaded, gains)


def instant(piece: Piece, position_text: str, option: str) -> float:
    """Seconds at a position of the piece such as `3|2.5`, `B+2`, `12.5s`. Raises OptionError."""
    from ergon.notation.clock.positions import parse_position
    from ergon.notation.text.errors import TextError

    tempo_map = piece.tempo_map
    try:
        return tempo_map.seconds(tempo_map.resolve(parse_position(position_text)))
    except TextError as error:
        hint = f"; did you mean '{error.suggestion}'?" if error.suggestion else ""
        raise OptionError(option, f"{error.message}{hint}") from None


def where(piece: Piece, seconds: float) -> str:
    """An instant as `bar|beat`."""
    tempo_map = piece.tempo_map
    return tempo_map.written(tempo_map.beats(seconds))


def marks_of(piece: Piece) -> list[tuple[str, float]]:
    """Marks with their beats, in order of time."""
    tempo_map = piece.tempo_map
    names_and_beats = ((mark.name, tempo_map.resolve(mark.at)) for mark in piece.marks)
    return sorted(names_and_beats, key=lambda mark: (mark[1], mark[0]))


def mark_instants(piece: Piece) -> list[tuple[str, float]]:
    """Marks with their instants [s], in order of time."""
    return [(name, piece.tempo_map.seconds(beats)) for name, beats in marks_of(piece)]


def mark_frames(piece: Piece, rate: float, start_frame: int) -> list[tuple[str, int]]:
    """Marks with their frames in a file that begins at frame `start_frame`, in order of time."""
    return [(name, round(instant * rate) - start_frame) for name, instant in mark_instants(piece)]


def level_of(piece: Piece, bits: Bits) -> Level:
    """The gain, high-pass and limiter between the mix and a file of `bits`."""
    is_measured = bits == "float"  # samples are in SI units, without a gain
    master = piece.mix.master
    return Level(
        normalise=master.normalise if master else None,
        limit=master.limit if master else None,
        highpass=None if is_measured else HIGHPASS_HZ,
        reference=piece.mix.reference(is_measured=is_measured),
        loudness=master.loudness if master else None,
    )


def played_level(piece: Piece) -> Level:
    """The level of a performance that is given no gain."""
    limit = master.limit if (master := piece.mix.master) is not None else None
    return Level(None, 1.0 if limit is None else limit, HIGHPASS_HZ, 1.0, piece.mix.reference())


def integer_rate(rate: float) -> int:
    """The rate of a file, which counts whole frames a second."""
    if rate != int(rate):
        raise OptionError(
            "rate", f"a WAV file has a whole number of frames per second, not {rate:g}"
        )
    return int(rate)


def _read_stdin() -> str:
    from ergon.notation.text.syntax import MAX_BYTES

    stdin_bytes = sys.stdin.buffer.read(MAX_BYTES + 1)
    if len(stdin_bytes) > MAX_BYTES:
        raise ErgonError(
            f"stdin is longer than {MAX_BYTES >> 20} MB, the most that a score may have"
        )
    try:
        return stdin_bytes.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ErgonError("stdin is not text in UTF-8") from None
