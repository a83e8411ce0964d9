"""`ergon render`: the sound of a score as a WAV file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.exchange.wave_header import CHANNELS_MAX, Bits

from . import options, score
from .console import Console
from .outcome import Diverged, Outcome, Refused
from .summary import dry_run, finer, rendered

if TYPE_CHECKING:
    from ergon.live.recorded import Recorded
    from ergon.rendering.render import Order
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

THREADS = min(2, os.cpu_count() or 1)  # one simulates, one mixes and writes
_BLOCK_MAX = 1 << 20  # frames: 24 s; more is memory without a gain


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the options ask for; what is not asked is as the score says."""

    output: str | None
    from_: str | None = None
    to: str | None = None
    stems: Path | None = None
    channels: int | None = None
    bits: Bits | None = None
    seed: int | None = None
    rate: float | None = None
    threads: int = THREADS
    block: int = 4096
    force: bool = False
    method: str | None = None
    error: str | None = None
    cents: float | None = None
    pinned: str | None = None
    hands: str | None = None
    freeze: str | None = None
    trust: bool = False

    @property
    def plan(self) -> score.Plan:
        """How exact."""
        return score.Plan(self.method, self.error, self.cents, self.pinned)

    @property
    def read(self) -> tuple[Path, ...]:
        """Files that are read beside the score's."""
        hands = () if self.hands is None else (Path(self.hands),)
        return *self.plan.read, *hands


@click.command()
@options.score
@options.target("The file to write; - is stdout. Without it: the score's, else SCORE.wav here.")
@click.option("--from", "from_", metavar="POSITION", help="Write from here (3|1, B+2, 12.5s).")
@click.option("--to", metavar="POSITION", help="Write up to here.")
@click.option(
    "--stems",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Also one file per player or instrument, into this folder.",
)
@click.option(
    "--channels",
    type=click.IntRange(1, CHANNELS_MAX),
    help="Channels of the file; where they are fewer, channel c goes to c modulo them.",
)
@options.bits
@options.seed
@click.option(
    "--rate",
    type=click.FloatRange(1_000, 768_000),
    help="Another rate [Hz]; physical parameters keep their meaning.",
)
@click.option(
    "--threads",
    type=click.IntRange(1, 1024),
    default=THREADS,
    help="Threads; the bytes are the same for any number.",
)
@click.option(
    "--block",
    type=click.IntRange(1, _BLOCK_MAX),
    default=4096,
    help="Frames computed at once; the bytes are the same for any number.",
)
@click.option(
    "--hands",
    metavar="FILE.take",
    help="What live hands did (ergon duet --record), at the level that was heard.",
)
@click.option(
    "--freeze",
    metavar="PART[,PART]",
    help="Instruments for `play --frozen`, into the folder -o or SCORE.frozen.",
)
@options.accuracy
@click.option("-n", "--dry-run", "dry", is_flag=True, help="Say what would be done, write nothing.")
@options.force
@click.option("--watch", is_flag=True, help="Render again whenever the score or its files change.")
@options.trust
@options.speaking
def render(
    console: Console,
    score_path: str,
    from_: str | None,
    output: str | None,
    dry: bool,
    watch: bool,
    **wished: object,
) -> None:
    """Compute the sound of a score, or of a session's journal, into a WAV file.

    The same score gives the same bytes, whatever the machine is doing. A render that is stopped
    leaves no file; only earlier renders are overwritten without -f.
    """
    wishes = Wishes(output=output, from_=from_, **wished)  # type: ignore[arg-type]
    if output == "-" and console.json:
        raise Refused("--json and -o - both want stdout")
    from .again import SUFFIX, render_journal

    if Path(score_path).suffix == SUFFIX:
        if dry or watch or wishes.freeze:
            raise Refused("a journal is rendered as it was played: no -n, --watch or --freeze")
        render_journal(console, Path(score_path), wishes)
    elif wishes.freeze is not None:
        _freeze(console, score_path, wishes, dry, watch)
    elif watch:
        _watch(console, score_path, wishes)
    else:
        render_file(console, score_path, wishes, dry)


def _freeze(console: Console, path: str, wishes: Wishes, dry: bool, watch: bool) -> None:
    from . import freezing

    others = {
        "--from": wishes.from_,
        "--to": wishes.to,
        "--stems": wishes.stems,
        "--channels": wishes.channels,
        "--bits": wishes.bits,
        "--hands": wishes.hands,
        "--watch": watch or None,
    }
    for option, value in others.items():
        if value is not None:
            raise Refused(f"--freeze writes whole parts as they are; {option} does nothing to them")
    if wishes.output == "-":
        raise Refused("--freeze writes a folder; stdout is none")
    parts = list(dict.fromkeys(filter(None, (wishes.freeze or "").replace(",", " ").split())))
    if not parts:
        raise Refused("--freeze: which instruments?")
    asked = freezing.Wishes(
        parts,
        wishes.output,
        wishes.seed,
        wishes.rate,
        wishes.threads,
        wishes.force,
        wishes.plan,
        wishes.trust,
    )
    freezing.freeze(console, path, asked, dry=dry)


def render_file(console: Console, path: str, wishes: Wishes, dry: bool = False) -> None:
    """Render one score; what it says stands on the console."""
    _render(console, path, score.read(console, path, trust=wishes.trust), wishes, dry)


def _render(console: Console, path: str, loaded: Loaded, wishes: Wishes, dry: bool) -> None:
    recorded = _recorded(console, loaded, wishes)
    staged = score.stage_piece(
        console,
        loaded,
        seed=wishes.seed,
        rate=wishes.rate,
        plan=wishes.plan,
        threads=wishes.threads,
        real=None if recorded is None else recorded.hands,
    )
    stage = staged.stage
    order = order_of(path, staged.piece, stage, wishes)
    order = replace(order, inputs=(*loaded.inputs, *wishes.read))
    if recorded is not None:
        order = replace(order, level=recorded.level)
    if dry:
        dry_run(console, stage, order)
        return
    from ergon.rendering.render import render as write_files

    task = f"rendering {Path(order.target).name}"
    total = min(order.stop, stage.n_frames)
    from ergon._core import DivergedError

    try:
        with console.progress(task, total, stage.rate) as progress:
            done = write_files(stage, order, progress.at)
    except DivergedError as error:
        score.show(console, loaded, [stage.fault(error)])
        raise Diverged from error
    rendered(console, done, order, staged.plan_s, stage.network)
    finer(console, stage.simulation)


def _recorded(console: Console, loaded: Loaded, wishes: Wishes) -> Recorded | None:
    """What hands did, where a recording is given."""
    if wishes.hands is None:
        return None
    from ergon.live.recorded import NotThisError, read

    piece = score.piece_of(loaded)
    try:
        recorded = read(
            Path(wishes.hands), piece if wishes.rate is None else replace(piece, rate=wishes.rate)
        )
    except NotThisError as error:
        raise Refused(f"--hands {error}") from None
    for doubt in recorded.doubts:
        console.warn(f"{wishes.hands}: {doubt}")
    return recorded


def order_of(path: str, piece: Piece, stage: Stage, wishes: Wishes) -> Order:
    """What is to be written, from the options and the score."""
    from ergon.exchange.wave_header import Stamp, WaveFormat
    from ergon.rendering.render import Order

    bits: Bits = wishes.bits or piece.render.bits
    n_channels = wishes.channels or piece.render.channels or stage.n_channels
    start = 0 if wishes.from_ is None else _frame(piece, stage, wishes.from_, "--from")
    stop = stage.n_frames if wishes.to is None else _frame(piece, stage, wishes.to, "--to")
    stop = min(stop, stage.n_frames)
    if start >= stop:
        end = score.where(piece, stage.n_frames / stage.rate)
        raise Refused(f"nothing lies between --from and --to; the piece ends at {end}")
    return Order(
        target=_target(path, piece, wishes.output),
        format=WaveFormat(score.whole_rate(stage.rate), n_channels, bits),
        start=start,
        stop=stop,
        level=score.level_of(piece, bits),
        stamp=Stamp(piece.title, piece.digest(), stage.plan.hash if stage.plan else ""),
        stems=wishes.stems,
        block=wishes.block,
        threads=wishes.threads,
        force=wishes.force,
    )


def _frame(piece: Piece, stage: Stage, position: str, option: str) -> int:
    """An instant t falls on sample floor(t·rate + ½)."""
    return int(score.instant(piece, position, option) * stage.rate + 0.5)


def _target(path: str, piece: Piece, output: str | None) -> str:
    if output is not None:
        return output
    if piece.render.file is not None:
        # Paths are relative to the file that names them.
        folder = Path() if path == score.STDIN else Path(path).parent
        return str(folder / piece.render.file)
    if path == score.STDIN:
        raise Refused("a score from stdin needs -o FILE")
    return Path(path).with_suffix(".wav").name


def _watch(console: Console, path: str, wishes: Wishes) -> None:
    from .app import explain
    from .watch import changes

    if path == score.STDIN or wishes.output == "-":
        raise Refused("--watch needs a score and a WAV file that are files")
    files = {Path(path)}
    first = True
    for _ in changes(files):
        try:
            loaded = score.read(console, path, trust=wishes.trust)
            files |= {Path(name) for name in loaded.files}
            _render(console, path, loaded, wishes, dry=False)
        except Exception as error:
            outcome: Outcome = explain(error)
            if isinstance(outcome, Refused) and first:  # wrong usage does not get better by waiting
                raise
            console.outcome(outcome)
            console.say(f"{path}: the last good render stays")
        first = False
        console.say(f"watching {path}; Ctrl-C ends")
