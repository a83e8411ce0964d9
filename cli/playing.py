"""What `play` and `duet` do: stage, preflight, perform, show, end."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.rendering.level import HIGHPASS, NORMALISE_DB

from . import freezing, score
from .console import Console
from .outcome import DeviceMissing, Refused
from .session import Session

if TYPE_CHECKING:
    from ergon import _core
    from ergon.exchange.frozen import Checked
    from ergon.live.boards import Board
    from ergon.live.calibration import Axis
    from ergon.live.osc import Osc
    from ergon.live.perform import Order
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

_NOT_HERE = ("N401",)  # that a live hand is not there: here it is, or its absence is seen


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the options ask for."""

    from_: str | None = None
    audio: str = "auto"
    block: int | None = None
    ahead: int | None = None
    gain: str | None = None
    loop: bool = False
    plain: bool = False
    strict: bool = False
    osc: str | None = None
    osc_to: str | None = None
    seed: int | None = None
    method: str | None = None
    error: str | None = None
    cents: float | None = None
    pinned: str | None = None
    live: Sequence[str] = ()
    guide: Sequence[str] = ()
    standin: Sequence[str] = ()
    record: str | None = None
    force_max: float | None = None
    frozen: Path | None = None
    unchecked: bool = False
    trust: bool = False

    @property
    def plan(self) -> score.Plan:
        """How exact."""
        return score.Plan(self.method, self.error, self.cents, self.pinned)


def play_score(console: Console, path: str, wishes: Wishes) -> None:
    """Play a score to its end, or until Ctrl-C."""
    loaded = score.read(console, path, leave_out=_NOT_HERE, trust=wishes.trust)
    written = score.piece_of(loaded)
    piece = _standing_in(written, wishes.standin)
    loaded = replace(loaded, piece=piece)
    boards = boards_of(piece, wishes)
    real = {player: None for board in boards for _, player in board.axes}
    osc = _osc(console, wishes)
    frozen = None
    if wishes.frozen is not None:
        frozen = freezing.read(console, written, wishes.frozen, wishes.seed)
        freezing.are_free(piece, frozen, real)
    boards = [ready(console, board, wishes.unchecked) for board in boards]
    staged = score.stage_piece(
        console,
        loaded,
        seed=wishes.seed,
        plan=wishes.plan,
        real=real,
        silent=() if frozen is None else frozen.parts,
        on_fault="mute",
    )
    stage = staged.stage
    stems: Sequence[Checked] = ()
    if frozen is not None and wishes.frozen is not None:
        stems = freezing.whole(stage, frozen, wishes.frozen)
        console.say(f"from {wishes.frozen}: {', '.join(frozen.parts)}")
    order = _order(console, piece, stage, boards, wishes, stems)
    from ergon import _core
    from ergon.live.perform import perform

    while True:
        try:
            with console.progress("going there", order.start, stage.rate) as progress:
                performance = perform(stage, order, progress.at)
        except _core.EngineError as error:
            raise DeviceMissing(_named(error, stage)) from None
        session = Session(
            console, stage, performance, boards, strict=wishes.strict, plain=wishes.plain
        )
        session.run(osc, order, partial(_borne, console, stage, performance))
        if not wishes.loop or (osc is not None and osc.stopped):
            return
        order = replace(order, start=0)


def _borne(console: Console, stage: Stage, performance: _core.Performance) -> None:
    """Tell whose forces are scaled."""
    for hand, part, met, limit in performance.borne():
        if part < 1.0:
            live = stage.live[hand]
            console.warn(
                f"{live.player} on {live.key}: the scene is {met:,.0f} N/m stiff there, and the "
                f"device bears {limit:,.0f} N/m at {stage.rate / live.every:.0f} Hz; its forces "
                f"are scaled to {part:.0%}"
            )


def _named(error: Exception, stage: Stage) -> str:
    """What the core refuses, with the player in the place of a hand's number."""

    def player(found: re.Match[str]) -> str:
        hand = stage.live[int(found[1])]
        return f"{hand.player} on {hand.key}:"

    return re.sub(r"^hand (\d+):", player, str(error))


def _standing_in(piece: Piece, pairs: Sequence[str]) -> Piece:
    """The piece with other takes or gestures in the place of absent hands."""
    players = dict(piece.players)
    for pair in pairs:
        name, _, what = pair.partition("=")
        if name not in players:
            raise Refused(_no_player(piece, name, "--standin"))
        if what not in piece.takes and what not in piece.gestures:
            raise Refused(f"--standin {pair}: no take or gesture is called '{what}'")
        if any(play.player == name for play in piece.parts):
            raise Refused(f"--standin {pair}: {name} has a part, which stands in")
        players[name] = replace(players[name], standin=what)
    return replace(piece, players=players)


def boards_of(piece: Piece, wishes: Wishes) -> list[Board]:
    """Devices that the wishes put under players' keys."""
    from ergon.live.boards import BoardError, boards, names, parse

    try:
        asked = parse(wishes.live)
        for name in asked:
            if name not in piece.players:
                raise Refused(_no_player(piece, name, "--live"))
        return boards(asked, names() if asked else {})
    except BoardError as error:
        raise Refused(f"--live: {error}") from None


def ready(console: Console, board: Board, unchecked: bool) -> Board:
    """The device with what is known of its axes; those of a board that may be another are tried.

    The classic accident is a motor wired the other way round: it drives away what it should hold.
    """
    from ergon import _core
    from ergon.live.boards import BoardError
    from ergon.live.calibration import certain, known

    try:
        found = known(board.url)
        sure = certain(board.url)
        for number, player in board.axes:
            if board.has_motor and not unchecked and number not in sure:
                _try(console, board, number, player, found)
    except BoardError as error:
        raise Refused(f"--live: {error}") from None
    except _core.EngineError as error:
        raise DeviceMissing(str(error)) from None
    return replace(board, known=found)


def _try(console: Console, board: Board, number: int, player: str, found: dict[int, Axis]) -> None:
    """Push an axis a little; `found` then has it as it is."""
    from ergon import _core
    from ergon.live.calibration import key, remember, tried

    before = found.get(number)
    sign = 1 if before is None else before.sign
    console.say(f"{player}: let go of the key; a small pulse finds out which way it goes")
    try:
        axis = tried(board.url, number, before)
        if board.emulated and axis.sign != sign:  # or a hand that moves it went along
            axis = tried(board.url, number, before)
    except _core.UnsureError as error:
        if board.emulated:
            console.warn(f"{player}: {error}; an emulated key plays without")
            return
        raise Refused(f"{player}: {error} (--unchecked plays without)") from None
    if axis.sign != sign and board.emulated:
        raise Refused(
            f"{player}: the motor pushes the wrong way; `ergon devices calibrate {board.url} "
            f"--axis {number}` puts it right (--unchecked plays without)"
        )
    if axis is before or board.emulated:
        return
    if before is not None:
        console.warn(
            f"{player}: {key(board.url, number)} goes the other way than was found before; it is "
            "taken for another board, and what was found of its ends is left out"
        )
    found[number] = axis
    remember(board.url, number, axis)


def _osc(console: Console, wishes: Wishes) -> Osc | None:
    if wishes.osc is None and wishes.osc_to is None:
        return None
    from ergon.live.datagrams import MissingError
    from ergon.live.osc import Osc, OscError, place

    try:
        here = None if wishes.osc is None else place(wishes.osc)
        there = None if wishes.osc_to is None else place(wishes.osc_to)
        osc = Osc(here, there)
    except MissingError as error:
        raise Refused(str(error)) from None
    except OscError as error:
        raise Refused(f"OSC: {error}") from None
    if osc.place is not None:
        host, port = osc.place
        if console.json:
            console.record("osc", host=host, port=port)
        console.say(f"OSC is heard at {host}:{port}")
    return osc


def _no_player(piece: Piece, name: str, option: str) -> str:
    from ergon.notation.text.spelling import nearest

    close = nearest(name, piece.players)
    asked = f"; did you mean '{close}'?" if close else ""
    return f"{option}: the score has no player '{name}'{asked}"


def _order(
    console: Console,
    piece: Piece,
    stage: Stage,
    boards: Sequence[Board],
    wishes: Wishes,
    frozen: Sequence[Checked],
) -> Order:
    from ergon.live.perform import Order, every

    start = 0
    if wishes.from_ is not None:
        start = int(score.instant(piece, wishes.from_, "--from") * stage.rate + 0.5)
        if start >= stage.n_frames:
            end = score.where(piece, stage.n_frames / stage.rate)
            raise Refused(f"--from {wishes.from_}: the piece ends at {end}")
    master = piece.mix.master
    limit = master.limit if master is not None and master.limit is not None else 1.0
    audio = wishes.audio if wishes.block is None else f"{wishes.audio},block={wishes.block}"
    if wishes.loop and (wishes.record or wishes.audio.startswith("file:")):
        raise Refused("--loop goes with neither --record nor file:, which are written once")
    score.whole_rate(stage.rate)
    record = None if wishes.record is None else _recording(wishes.record, stage)
    order = Order(
        audio=audio,
        gain=gain(console, piece, stage, wishes, frozen),
        limit=limit,
        highpass=HIGHPASS,
        start=start // every(stage) * every(stage),
        boards=boards,
        guides=_guides(piece, boards, wishes.guide),
        force_max=wishes.force_max,
        ahead=wishes.ahead,
        record=record,
        frozen=frozen,
    )
    if record is None:
        return order
    return replace(order, about=_about(piece, stage, order, wishes))


def _about(piece: Piece, stage: Stage, order: Order, wishes: Wishes) -> dict[str, object]:
    """What stands at the beginning of a recording."""
    from ergon import _core
    from ergon.live.calibration import as_recorded
    from ergon.live.recorded import about

    devices = {
        player: as_recorded(board, number)
        for board in order.boards
        for number, player in board.axes
    }
    return {
        "made": f"by ergon {_core.__version__}",
        "day": time.strftime("%Y-%m-%d %H:%M:%S"),
        "score": {"sha256": piece.digest(), "title": piece.title},
        "seed": piece.seed if wishes.seed is None else wishes.seed,
        "plan": stage.plan.hash if stage.plan else "",
        "level": about(order),
        "axes": [devices.get(hand.player, {"device": None}) for hand in stage.live],
    }


def gain(
    console: Console, piece: Piece, stage: Stage, wishes: Wishes, frozen: Sequence[Checked]
) -> float:
    """As asked, as the score's master says, or as a preflight finds."""
    from ergon import _core
    from ergon.live.preflight import length, level
    from ergon.notation.tables.quantities import gain as ratio
    from ergon.notation.text.errors import TextError

    if wishes.gain is not None:
        try:
            return ratio(wishes.gain)
        except TextError as error:
            raise Refused(f"--gain: {error.message}") from None
    master = piece.mix.master
    if master is not None and master.normalise is None:
        return 1.0
    target = master.normalise if master is not None and master.normalise else None
    with console.progress("listening beforehand", length(stage), stage.rate) as progress:
        target = target or _core.decibels(NORMALISE_DB)
        found = level(stage, HIGHPASS, target, frozen, progress.at)
    heard = "" if found.seconds is None else f" (the first {found.seconds:.0f} s were listened to)"
    from .units import decibels

    gained = f"{decibels(found.gain):+.1f} dB"
    console.say(f"gain {gained} by a preflight{heard}; --gain sets another")
    return found.gain


def _guides(piece: Piece, boards: Sequence[Board], asked: Sequence[str]) -> dict[str, float]:
    from ergon.live.perform import GUIDE
    from ergon.notation.tables.quantities import STIFFNESS, quantity
    from ergon.notation.text.errors import TextError

    real = {player for board in boards for _, player in board.axes}
    guides = {}
    for text in asked:
        player, is_said, stiffness = text.partition("=")
        if player not in real:
            if player not in piece.players:
                raise Refused(_no_player(piece, player, "--guide"))
            raise Refused(f"--guide {text}: {player} has no device; add --live {player}=DEVICE")
        try:
            guides[player] = quantity(stiffness, STIFFNESS) if is_said else GUIDE[0]
        except TextError as error:
            raise Refused(f"--guide {text}: {error.message}") from None
    return guides


def _recording(path: str, stage: Stage) -> Path:
    if not stage.live:
        raise Refused("--record keeps what live hands do; this needs a --live hand")
    target = Path(path)
    if target.exists():
        raise Refused(f"{path} is there already, and a recording overwrites nothing")
    return target
