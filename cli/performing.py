"""What `repl` does: a score or a journal, an engine, a session, a prompt."""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.rendering.level import HIGHPASS

from . import playing, score
from .console import Console
from .outcome import DeviceMissing, Findings, Refused

if TYPE_CHECKING:
    from ergon.live.boards import Board
    from ergon.live.perform import Order
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.disk import Disk
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.recorded import Opening
    from ergon.repl.session.session import Session
    from ergon.repl.session.version import Version
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

# What a change takes from the session to the physics thread: its tick, and a busy machine [s].
_MARGIN = 0.006
_SWITCH = 0.0005  # [s]


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the options ask for."""

    live: Sequence[str] = ()
    unchecked: bool = False
    force_max: float | None = None
    audio: str = "auto"
    block: int | None = None
    ahead: int | None = None
    gain: str | None = None
    journal: Path = Path("session.jsonl")
    resume: Path | None = None
    watch: bool = False
    socket: str | None = None
    engine: bool = False
    plain: bool = False
    strict: bool = False
    trust: bool = False

    @property
    def playing(self) -> playing.Wishes:
        """The same, as `play` asks."""
        return playing.Wishes(
            audio=self.audio,
            block=self.block,
            ahead=self.ahead,
            gain=self.gain,
            live=self.live,
            force_max=self.force_max,
            unchecked=self.unchecked,
        )


def perform(console: Console, path: str | None, wishes: Wishes) -> None:
    """Serve a session until somebody leaves."""
    from ergon._core import stop_on_signals
    from ergon.repl.prompt.run import history_of_user, run

    session = begun(console, path, wishes)
    if run(
        session,
        plain=wishes.plain,
        strict=wishes.strict,
        history=history_of_user(),
        watch=stop_on_signals,
    ):
        raise Findings


def begun(console: Console, path: str | None, wishes: Wishes) -> Session:
    """A session that sounds; whoever has it closes it."""
    from ergon import _core
    from ergon.exchange.plan_store import of_user
    from ergon.repl.prompt.signals import left_to_me
    from ergon.repl.session.journal import Journal, JournalError, free
    from ergon.repl.session.session import Session

    version, clock, gain, disk = _beginning(console, path, wishes)
    piece = version.piece
    boards = [
        playing.ready(console, board, wishes.unchecked)
        for board in playing.boards_of(piece, wishes.playing)
    ]
    real = {player: None for board in boards for _, player in board.axes}
    with score.staging(console, version.texts.load):
        order = _order(console, piece, wishes, boards, gain)
    try:
        journal = Journal.begun(wishes.journal)
    except JournalError as error:
        raise Refused(str(error)) from None
    try:
        hands = free(journal.path.with_suffix(".take")) if real else None
        order = replace(order, record=hands, about={"journal": journal.path.name})
        make, opening = _engine(console, version, clock, order)
        with score.staging(console, version.texts.load):
            session = Session(
                version,
                make,
                margin=_MARGIN,
                journal=journal,
                real=real,
                store=of_user(),
                clock=clock,
                hands=hands,
                disk=disk,
                watches=wishes.watch,
            )
    except BaseException:
        journal.close()
        journal.path.unlink(missing_ok=True)  # nothing has begun
        raise
    began = opening(session.commits.engine.every).fields()
    journal.tell("session", **began, disk=session.disk.said(version.texts))
    # Nothing of what is there now goes away while it plays: no search for cycles in it.
    gc.collect()
    gc.freeze()
    # A line at work hands the interpreter over so soon to whoever stops a hand.
    sys.setswitchinterval(_SWITCH)
    # A notebook's Ctrl-C ends a call, not the session: hands are let go, until `release`.
    _core.stop_on_signals([signal.SIGINT], ends=False)
    with left_to_me():
        session.run()
    return session


def _beginning(
    console: Console, path: str | None, wishes: Wishes
) -> tuple[Version, Clock, float | None, Disk | None]:
    """The first version, where its piece stands, the gain where it is known, and the disk."""
    from ergon.repl.session.clock import Clock
    from ergon.repl.session.journal import JournalError
    from ergon.repl.session.recorded import opened
    from ergon.repl.session.replay import resumed
    from ergon.repl.session.version import NotTakenError, Version
    from ergon.scores.edits.texts import Texts

    resume = wishes.resume
    if resume is not None:
        try:
            replay = opened(resume, path, resumes=True, trust=wishes.trust)
            return *resumed(replay), replay.opening.gain, replay.disk
        except JournalError as error:
            raise Refused(f"--resume: {error}") from None
        except NotTakenError as error:
            raise Refused(f"--resume: {resume}: {error}") from None
    if path is None:
        raise Refused("a score is missing, or --resume JOURNAL")
    loaded = score.read(console, path, leave_out=("N401",), trust=wishes.trust)
    piece = score.piece_of(loaded)
    texts = Texts.read(path, score.bounds(path, wishes.trust))
    return Version(0, "", texts, piece), Clock(), None, None


def _order(
    console: Console,
    piece: Piece,
    wishes: Wishes,
    boards: Sequence[Board],
    gain: float | None,
) -> Order:
    from ergon.exchange.plan_store import of_user
    from ergon.live.perform import Order
    from ergon.scores.staging.stage import stage

    master = piece.mix.master
    score.whole_rate(piece.rate)
    audio = wishes.audio if wishes.block is None else f"{wishes.audio},block={wishes.block}"
    if audio.startswith("file:"):  # whoever types does so by the clock
        audio = audio.replace("file:", "clock:", 1)
    if gain is None or wishes.gain is not None:
        from ergon.repl.session.running import rehearsal

        played = piece if piece.parts or piece.strikes else rehearsal(piece)
        whole = stage(played, planned=True, store=of_user(), on_fault="mute")
        gain = playing.gain(console, played, whole, wishes.playing, ())
    return Order(
        audio=audio,
        gain=gain,
        limit=master.limit if master is not None and master.limit is not None else 1.0,
        highpass=HIGHPASS,
        boards=boards,
        force_max=wishes.force_max,
        ahead=wishes.ahead,
    )


def _engine(
    console: Console, version: Version, clock: Clock, order: Order
) -> tuple[Callable[[Stage], Engine], Callable[[int], Opening]]:
    from ergon import _core
    from ergon.repl.prompt.signals import left_to_me
    from ergon.repl.session.live import Live
    from ergon.repl.session.recorded import Opening

    def make(stage: Stage) -> Engine:
        try:
            with left_to_me():  # not to the physics, nor to who looks after it
                engine = Live(stage, order)
        except _core.EngineError as error:
            raise DeviceMissing(str(error)) from None
        console.say(engine.performance.output())
        return engine

    def opening(every: int) -> Opening:
        heard = order.gain, order.limit, order.highpass
        return Opening(version.texts, clock.at, version.desk, every, *heard)

    return make, opening
