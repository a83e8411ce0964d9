"""Parts of a score, computed beforehand: written as frozen files, read for a performance."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.common.shown_paths import is_from_pack
from ergon.scores.reading.digest import digest_of

from . import score as scores
from .errors import OptionError
from .options import THREADS, AccuracyOptions

if TYPE_CHECKING:
    from ergon.exchange.frozen import Frozen, Source, VerifiedStem
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

# Extra time [s]: with a real hand a piece may be longer, as the hand's stand-in ends with a tick.
_EXTRA_DURATION = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FreezeOptions(AccuracyOptions):
    """How parts are frozen.

    `rate` [Hz] replaces the score's. `threads` is the number of threads, and changes no sample.
    With `force`, files that ergon did not write are overwritten.
    """

    rate: float | None = None
    threads: int = THREADS
    force: bool = False


@dataclass(frozen=True, slots=True)
class PreparedFreeze:
    """A staged score whose parts can be frozen; `taps` has the outputs of each part."""

    folder: Path
    taps: Mapping[str, Sequence[int]]
    n_frames: int
    loaded: Loaded
    stage: Stage


def freeze(
    score: str | Path,
    parts: Sequence[str],
    out: str | Path | None = None,
    options: FreezeOptions | None = None,
    *,
    report: Report | None = None,
) -> Frozen:
    """Compute instruments of a score into the folder `out`, or SCORE.frozen beside the score.

    Raises ScoreError, DivergedError, OptionError, and FileRefusedError where a file may not be
    written.
    """
    options, report = options or FreezeOptions(), report or Report()
    return write(prepare(score, parts, out, options, report), options, report)


def prepare(
    score: str | Path,
    parts: Sequence[str],
    out: str | Path | None,
    options: FreezeOptions,
    report: Report,
) -> PreparedFreeze:
    """Stage a score of which only these parts are heard; an instrument with `notes` names all of
    its notes.
    """
    loaded = scores.read(score, options, report)
    piece = scores.piece_of(loaded)
    parts = [part for name in parts for part in piece.families.get(name, (name,))]
    _check_instruments(piece, parts)
    live_players = [player.name for player in piece.players.values() if player.hand == "live"]
    _check_untouched(piece, parts, live_players, "freeze")
    stage = scores.stage_piece(
        loaded,
        options,
        report,
        rate=options.rate,
        threads=options.threads,
        silent=[part for part in _audible_parts(piece) if part not in parts],
    ).stage
    folder = Path(out) if out is not None else _frozen_folder(str(score))
    taps_by_part = {part: stage.listening.taps(part) for part in parts}
    n_frames = stage.n_frames + int(_EXTRA_DURATION * stage.rate)
    return PreparedFreeze(folder, taps_by_part, n_frames, loaded, stage)


def write(prepared: PreparedFreeze, options: FreezeOptions, report: Report) -> Frozen:
    """Compute and write the parts."""
    from ergon.rendering.frozen import write_frozen_parts as write_files

    stage, loaded = prepared.stage, prepared.loaded
    with (
        scores.computing(stage, loaded, report),
        report.progress("freezing", prepared.n_frames, stage.rate) as progress,
    ):
        return write_files(
            stage,
            prepared.taps,
            _frozen_source(loaded, stage),
            prepared.folder,
            progress.update,
            n_frames=prepared.n_frames,
            force=options.force,
            threads=options.threads,
            inputs=(*loaded.inputs, *options.files),
        )


def _frozen_folder(path: str) -> Path:
    if path == scores.STDIN:
        raise OptionError("output", "a score from stdin has no name for the folder; name one")
    folder = Path(path).with_suffix(".frozen")
    return Path(folder.name) if is_from_pack(path) else folder


def _audible_parts(piece: Piece) -> list[str]:
    from ergon.scores.staging.listening import audible_outputs

    return list(dict.fromkeys(instrument.name for _, instrument, _ in audible_outputs(piece)))


def _check_instruments(piece: Piece, part_names: Iterable[str]) -> None:
    from ergon.notation.text.spelling import nearest

    audible_names = _audible_parts(piece)
    for part in part_names:
        if part in audible_names:
            continue
        if part in piece.instruments:
            raise OptionError(
                "freeze",
                "this instrument has no route to a channel; add a route to the mix",
                value=part,
            )
        families = piece.note_families()
        instrument_names = list(dict.fromkeys(families.get(name, name) for name in audible_names))
        nearest_name = nearest(part, [*instrument_names, *audible_names])
        hint = (
            f"; did you mean '{nearest_name}'?"
            if nearest_name
            else f"; there are {', '.join(instrument_names)}"
        )
        raise OptionError("freeze", f"the score has no instrument '{part}'{hint}")


def _check_untouched(
    piece: Piece, part_names: Collection[str], live_players: Iterable[str], option: str
) -> None:
    from ergon.scores.staging.reach import freeze_obstacles

    obstacles = freeze_obstacles(piece, part_names, live_players)
    if obstacles:
        raise OptionError(option, "; ".join(map(str, obstacles)))


def _frozen_source(loaded: Loaded, stage: Stage) -> Source:
    from ergon import _core
    from ergon.exchange.frozen import Source

    piece = scores.piece_of(loaded)
    return Source(
        title=piece.title,
        score=digest_of(piece),
        seed=stage.piece.seed,
        rate=float(scores.integer_rate(stage.rate)),
        version=_core.__version__,
        plan=stage.plan.hash if stage.plan else "",
    )


# --- beside a performance -----------------------------------------------------------------------


def read(piece: Piece, folder: Path, seed: int | None, report: Report) -> Frozen:
    """Read the manifest of a folder of frozen parts. Raises OptionError if it is of another
    piece.
    """
    from ergon import _core
    from ergon.exchange.frozen import NotFrozenError
    from ergon.exchange.frozen import read as read_manifest

    try:
        frozen = read_manifest(folder)
    except NotFrozenError as error:
        raise OptionError("frozen", str(error)) from None
    frozen_source = frozen.source
    freeze_command = f"ergon render SCORE --freeze {','.join(frozen.parts)} -o {folder}"
    seed = piece.seed if seed is None else seed

    def refusal(reason: str) -> OptionError:
        return OptionError("frozen", reason, value=str(folder))

    if frozen_source.score != digest_of(piece):
        raise refusal(
            f"the score has changed since its parts were frozen; `{freeze_command}` freezes them "
            "again"
        )
    if frozen_source.seed != seed:
        raise refusal(
            f"the parts were frozen with seed {frozen_source.seed}, and this performance has seed "
            f"{seed}; --seed {frozen_source.seed} plays them, `{freeze_command} --seed {seed}` "
            "freezes them again"
        )
    if frozen_source.rate != piece.rate:
        raise refusal(
            f"the parts were frozen at {frozen_source.rate:g} Hz, and the score has {piece.rate:g} "
            f"Hz; `{freeze_command}` freezes them again"
        )
    if frozen_source.version != _core.__version__:
        report.warn(
            f"{folder} was frozen by ergon {frozen_source.version}: this version may compute other "
            "sound"
        )
    return frozen


def check_freezable(piece: Piece, frozen: Frozen, real_players: Iterable[str]) -> None:
    """Raise OptionError if a hand can feel a frozen part."""
    live_players = [player.name for player in piece.players.values() if player.hand == "live"]
    _check_untouched(piece, frozen.parts, dict.fromkeys((*live_players, *real_players)), "frozen")


def verify_stems(stage: Stage, frozen: Frozen, folder: Path) -> list[VerifiedStem]:
    """The stems, each read once and hashed. Raises OptionError where one has changed."""
    from ergon.exchange.frozen import NotFrozenError, check

    taps_by_part = {part: stage.listening.taps(part) for part in frozen.parts}
    try:
        return check(frozen, taps_by_part, stage.n_frames)
    except NotFrozenError as error:
        parts_text = ",".join(frozen.parts)
        freeze_advice = (
            f"`ergon render SCORE --freeze {parts_text} -o {folder}` freezes the parts again"
        )
        raise OptionError("frozen", f"{error}; {freeze_advice}", value=str(folder)) from None
