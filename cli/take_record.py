"""`ergon take record`: what hands do on devices, without a score."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options, recording
from .console import Console
from .outcome import DeviceMissing, Refused

if TYPE_CHECKING:
    from ergon import _core
    from ergon.live.pointer_hands import PointerHands

_POLL_SECONDS = 0.1  # [s]
_HAND = "hand"


@click.command("record")
@click.option(
    "--live",
    multiple=True,
    required=True,
    metavar="[PLAYER=]DEVICE",
    help="A hand on a device, such as remi=firefader:/dev/ttyACM0#1; again for more.",
)
@options.target("The new recording, a .take file.")
@click.option(
    "--seconds",
    type=options.Number(0, 86400, "DURATION", min_open=True),
    help="End after this many seconds.",
)
@click.option(
    "--tick",
    type=options.Number(10, 44100, "TICK_RATE"),
    default=1000.0,
    show_default=True,
    help="Positions recorded a second.",
)
@options.with_console
def record(
    console: Console, live: tuple[str, ...], output: str | None, seconds: float | None, tick: float
) -> None:
    """Record what a hand does on a device, without any force.

    It ends after --seconds, or with Ctrl-C. With a score, and with what a key feels in it,
    `ergon duet SCORE --live PLAYER=DEVICE --record FILE.take` records.
    """
    from ergon import _core
    from ergon.live.capture import capture

    if output is None:
        raise Refused("name the file to write, by -o NEW.take")
    path = Path(output)
    if path.suffix.lower() != recording.SUFFIX:
        raise Refused(f"{output}: the name of a recording ends in {recording.SUFFIX}")
    if path.exists():
        raise Refused(f"{path} exists, and a recording overwrites no file")
    hands = _hands(live)
    try:
        performance = capture(hands.boards, path, tick_rate=tick, record_seconds=seconds)
    except _core.EngineError as error:
        if error.module == "record":  # somebody else's file may be there by now
            raise Refused(str(error)) from None
        path.unlink(missing_ok=True)
        raise DeviceMissing(str(error)) from None
    console.say("recording" + ("; Ctrl-C ends it" if seconds is None else f" {seconds:g} s"))
    try:
        _wait_until_over(console, performance)
    finally:
        performance.stop()
        hands.close()
        try:
            performance.close(0.1)
        except _core.EngineError as error:
            raise Refused(f"{path}: {error}; the recording up to there is kept") from None
        recording.say(console, path, recording.read(console, path), dry=False)


def _wait_until_over(console: Console, performance: _core.Performance) -> None:
    is_reported = False
    while not performance.wait(_POLL_SECONDS):
        recording_trouble = performance.recording_trouble()
        if recording_trouble and not is_reported:
            console.warn(f"the recording cannot be written: {recording_trouble}")
        is_reported = recording_trouble is not None
        # Without its device a hand does not move: there is nothing more to record of it.
        gone_events = [
            event_kind for _, event_kind, _ in performance.events() if event_kind == "gone"
        ]
        if gone_events:
            console.warn("the device is gone; the recording up to there is kept")
            return


def _hands(live: tuple[str, ...]) -> PointerHands:
    from dataclasses import replace

    from ergon.live.boards import PAGE_KINDS, BoardError, boards, device_urls, parse_live_options
    from ergon.live.calibration import stored_calibrations
    from ergon.live.pointer_hands import open_pointer_hands

    try:
        hand_boards = boards(parse_live_options(_with_player_names(live)), device_urls())
        if any(board.kind in PAGE_KINDS for board in hand_boards):
            raise BoardError("a page's key needs a piece: `ergon duet SCORE --record` records it")
        return open_pointer_hands(
            [replace(board, calibrations=stored_calibrations(board.url)) for board in hand_boards]
        )
    except BoardError as error:
        raise Refused(f"--live: {error}") from None


def _with_player_names(live: tuple[str, ...]) -> list[str]:
    """Give hands without a player's name the names hand, hand2 …"""
    hand_pairs = []
    for hand_text in live:
        player, equals_sign, _ = hand_text.partition("=")
        # The options of a URL may hold a `=` too, but only after its colon.
        if equals_sign and ":" not in player:
            hand_pairs.append(hand_text)
        else:
            number = 1 + sum(pair.startswith(_HAND) for pair in hand_pairs)
            hand_pairs.append(f"{_HAND}{number if number > 1 else ''}={hand_text}")
    return hand_pairs
