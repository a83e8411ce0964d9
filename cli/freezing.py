"""Prepared parts: `ergon render --freeze` writes them, `play --frozen` plays beside them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from . import score
from .console import Console, plural
from .outcome import Diverged, Refused
from .summary import finer

if TYPE_CHECKING:
    from ergon.exchange.frozen import Checked, Frozen, Source
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage


# A real hand's stand-in ends with a tick, so a piece may be longer than it is without one [s].
_LONGER = 1.0


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the options ask for."""

    parts: Sequence[str]
    output: str | None
    seed: int | None
    rate: float | None
    threads: int
    force: bool
    plan: score.Plan
    trust: bool = False


def freeze(console: Console, path: str, wishes: Wishes, *, dry: bool = False) -> None:
    """Compute parts of a score into a folder."""
    from ergon._core import DivergedError
    from ergon.rendering.frozen import write

    loaded = score.read(console, path, trust=wishes.trust)
    piece = score.piece_of(loaded)
    _are_there(piece, wishes.parts)
    live = [player.name for player in piece.players.values() if player.hand == "live"]
    _are_free(piece, wishes.parts, live, "--freeze")
    heard = _heard(piece)
    staged = score.stage_piece(
        console,
        loaded,
        seed=wishes.seed,
        rate=wishes.rate,
        plan=wishes.plan,
        threads=wishes.threads,
        silent=[part for part in heard if part not in wishes.parts],
    )
    stage = staged.stage
    source = _source(loaded, stage)
    folder = Path(wishes.output) if wishes.output is not None else _folder(path)
    taps = {part: stage.listening.taps(part) for part in wishes.parts}
    n_frames = stage.n_frames + int(_LONGER * stage.rate)
    if dry:
        _say(console, folder, taps, n_frames, stage.rate, dry=True)
        return
    try:
        with console.progress("freezing", n_frames, stage.rate) as progress:
            write(
                stage,
                taps,
                source,
                folder,
                progress.at,
                n_frames=n_frames,
                force=wishes.force,
                threads=wishes.threads,
                inputs=(*loaded.inputs, *wishes.plan.read),
            )
    except DivergedError as error:
        score.show(console, loaded, [stage.fault(error)])
        raise Diverged from error
    _say(console, folder, taps, n_frames, stage.rate, dry=False)
    finer(console, stage.simulation)


def _folder(path: str) -> Path:
    if path == score.STDIN:
        raise Refused("a score from stdin needs -o DIR")
    return Path(path).with_suffix(".frozen")


def _say(
    console: Console,
    folder: Path,
    taps: Mapping[str, Sequence[int]],
    n_frames: int,
    rate: float,
    *,
    dry: bool,
) -> None:
    n_taps = sum(map(len, taps.values()))
    n_bytes = n_frames * n_taps * 8
    if console.json:
        console.record(
            "would_freeze" if dry else "frozen",
            folder=str(folder),
            parts=list(taps),
            frames=n_frames,
            outputs=n_taps,
            disk_bytes=n_bytes,
        )
        return
    from .units import octets, seconds

    word = "would hold" if dry else "holds"
    length, outputs = seconds(n_frames / rate), plural(n_taps, "output")
    console.say(f"{folder} {word} {', '.join(taps)}: {length}, {outputs}, {octets(n_bytes)}")


def _heard(piece: Piece) -> list[str]:
    from ergon.scores.staging.listening import heard

    return list(dict.fromkeys(instrument.name for _, instrument, _ in heard(piece)))


def _are_there(piece: Piece, parts: Iterable[str]) -> None:
    from ergon.notation.text.spelling import nearest

    heard = _heard(piece)
    for part in parts:
        if part in heard:
            continue
        if part in piece.instruments:
            raise Refused(f"--freeze {part}: no route brings it to a loudspeaker")
        close = nearest(part, heard)
        asked = f"; did you mean '{close}'?" if close else f"; there are {', '.join(heard)}"
        raise Refused(f"--freeze: the score has no instrument '{part}'{asked}")


def _are_free(piece: Piece, parts: Collection[str], live: Iterable[str], option: str) -> None:
    from ergon.scores.staging.reach import ties

    found = ties(piece, parts, live)
    if found:
        raise Refused("; ".join(f"{option}: {tie}" for tie in found))


def _source(loaded: Loaded, stage: Stage) -> Source:
    from ergon import _core
    from ergon.exchange.frozen import Source

    piece = score.piece_of(loaded)
    return Source(
        title=piece.title,
        score=piece.digest(),
        seed=stage.piece.seed,
        rate=float(score.whole_rate(stage.rate)),
        version=_core.__version__,
        plan=stage.plan.hash if stage.plan else "",
    )


# --- beside a performance -----------------------------------------------------------------------


def read(console: Console, piece: Piece, folder: Path, seed: int | None) -> Frozen:
    """What a folder says that it holds, if that is of this piece."""
    from ergon import _core
    from ergon.exchange.frozen import NotFrozenError
    from ergon.exchange.frozen import read as read_manifest

    try:
        frozen = read_manifest(folder)
    except NotFrozenError as error:
        raise Refused(f"--frozen {error}") from None
    source = frozen.source
    again = f"ergon render SCORE --freeze {','.join(frozen.parts)} -o {folder}"
    seed = piece.seed if seed is None else seed
    if source.score != piece.digest():
        raise Refused(f"--frozen {folder}: the score has changed since; {again} freezes it anew")
    if source.seed != seed:
        raise Refused(
            f"--frozen {folder}: it is of seed {source.seed}, this is {seed}; "
            f"--seed {source.seed} plays it, or {again} --seed {seed}"
        )
    if source.rate != piece.rate:
        raise Refused(
            f"--frozen {folder}: it is at {source.rate:g} Hz, the score at {piece.rate:g} Hz; "
            f"{again} freezes it anew"
        )
    if source.version != _core.__version__:
        console.warn(f"{folder} was frozen by ergon {source.version}: it may sound differently")
    return frozen


def are_free(piece: Piece, frozen: Frozen, real: Iterable[str]) -> None:
    """Refused where a hand can feel a part that is frozen."""
    live = [player.name for player in piece.players.values() if player.hand == "live"]
    _are_free(piece, frozen.parts, dict.fromkeys((*live, *real)), "--frozen")


def whole(stage: Stage, frozen: Frozen, folder: Path) -> list[Checked]:
    """The stems, once they were read and hashed."""
    from ergon.exchange.frozen import NotFrozenError, check

    taps = {part: stage.listening.taps(part) for part in frozen.parts}
    try:
        return check(frozen, taps, stage.n_frames)
    except NotFrozenError as error:
        parts = ",".join(frozen.parts)
        again = f"ergon render SCORE --freeze {parts} -o {folder} freezes it anew"
        raise Refused(f"--frozen {folder}: {error}; {again}") from None
