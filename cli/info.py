"""`ergon info`: what a render, a take or a score contains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.options import ReadOptions

from . import options
from .console import Console, plural
from .outcome import Findings, Refused
from .units import octets, seconds

if TYPE_CHECKING:
    from ergon.exchange.wave_header import WaveInfo


@click.command()
@click.argument("file", metavar="FILE")
@click.option("--score", "of", metavar="SCORE", help="Check that a render comes from this score.")
@options.trust
@options.speaking
def info(console: Console, file: str, of: str | None, trust: bool) -> None:
    """Say what a render, a take or a score contains.

    A WAV file is a render: its format, title, the hash of its score and of its samples. A .take,
    CSV or npz file is a take: its channels and what they span. Anything else is read as a score.
    """
    path = Path(file)
    suffix = path.suffix.lower()
    if of is not None and suffix != ".wav":
        raise Refused("--score verifies a rendered WAV file")
    if suffix == ".wav":
        _render(console, path, of, trust)
    elif suffix in (".take", ".csv", ".npz"):
        from .take_info import take

        take(console, path)
    else:
        _score(console, file, trust)


def _render(console: Console, path: Path, of: str | None, trust: bool) -> None:
    from ergon.exchange.wave import hash_samples, read_info
    from ergon.exchange.wave_header import NotWaveError

    try:
        found = read_info(path)
        samples = hash_samples(path)
    except NotWaveError as error:
        raise Refused(f"{path}: {error}") from None
    if console.json:
        console.record("render", **_fields(path, found), samples_sha256=samples)
    else:
        console.data(_lines(path, found, samples))
    if of is None:
        return
    if found.score is None:
        raise Findings(f"{path} does not say which score it comes from")
    if score.piece_of(score.read(of, ReadOptions(trust=trust), console)).digest() != found.score:
        raise Findings(f"{path} was rendered from another score than {of}, or an earlier state")
    console.say(f"{path} was rendered from {of} as it is now")


def _fields(path: Path, found: WaveInfo) -> dict[str, object]:
    return {
        "file": str(path),
        "container": found.container,
        "rate_hz": found.format.rate,
        "channels": found.format.n_channels,
        "bits": found.format.bits,
        "frames": found.n_frames,
        "duration_s": found.n_frames / found.format.rate,
        "originator": found.originator,
        "title": found.title,
        "score_sha256": found.score,
        "plan_sha256": found.plan,
    }


def _lines(path: Path, found: WaveInfo, samples: str) -> str:
    bits = found.format.bits
    form = {"float": "32-bit float", "double": "64-bit float"}.get(str(bits), f"{bits} bits")
    lines = [
        f"{path}: {seconds(found.n_frames / found.format.rate)} ({found.n_frames:,} frames), "
        f"{plural(found.format.n_channels, 'channel')}, {found.format.rate} Hz, {form}, "
        f"{found.container}, {octets(found.offset + found.size)}",
    ]
    if found.title:
        lines.append(f"title:   {found.title}")
    lines.append(f"made by: {found.originator or 'not said'}")
    if found.score:
        lines.append(f"score:   sha256 {found.score}")
    if found.plan:
        lines.append(f"plan:    sha256 {found.plan}")
    lines.append(f"samples: sha256 {samples}")
    return "\n".join(lines) + "\n"


def _score(console: Console, path: str, trust: bool) -> None:
    ready = score.stage_piece(score.read(path, ReadOptions(trust=trust), console), None, console)
    piece, staged = ready.piece, ready.stage
    duration = staged.n_frames / staged.rate
    end = score.where(piece, duration)
    groups = {
        "players": list(piece.players),
        "keys": list(piece.keys),
        "instruments": list(piece.instruments),
        "gestures": list(piece.gestures),
        "takes": list(piece.takes),
        "marks": [name for name, _ in score.marks_of(piece)],
    }
    if console.json:
        console.record(
            "score",
            file=path,
            title=piece.title,
            score_sha256=piece.digest(),
            duration_s=duration,
            end=end,
            rate_hz=staged.rate,
            channels=staged.n_channels,
            modules=staged.network.n_mat + staged.network.n_lia,
            **groups,
        )
        return
    lines = [
        f"{path}: {piece.title or 'without a title'}",
        f"  {seconds(duration)}, to {end}; {plural(staged.n_channels, 'channel')} at "
        f"{staged.rate:g} Hz; {plural(staged.network.n_mat, 'MAT')}, "
        f"{plural(staged.network.n_lia, 'LIA')}",
    ]
    lines += [f"  {kind}: {', '.join(names)}" for kind, names in groups.items() if names]
    lines.append(f"  sha256 {piece.digest()}")
    console.data("\n".join(lines) + "\n")
