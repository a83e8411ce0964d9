"""How positions arrive from inputs of keys without a device, measured while somebody moves them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ergon.common.report import Report

from .errors import OptionError
from .pages import ANY_LOCAL_PORT, serve

if TYPE_CHECKING:
    from ergon.live.fitness import Finding
    from ergon.live.pointer_hands import PointerHands

_POLL_SECONDS = 0.02  # [s] between two looks whether something came
_WAIT_SECONDS_MAX = 120.0  # [s] for the first position


def measure_hands(
    addresses: Sequence[str], measure_seconds: float, report: Report
) -> list[Finding]:
    """Measure for some seconds after each input has sent its first position; one finding for each.

    Raises OptionError for an address that is none of a key without a device, or cannot be opened.
    """
    from ergon.live.boards import BoardError, boards
    from ergon.live.hand_arrivals import describe_arrivals
    from ergon.live.pointer_address import is_pointer_driven
    from ergon.live.pointer_hands import open_pointer_hands

    url_by_hand = {f"hand{number}": address for number, address in enumerate(addresses, 1)}
    try:
        known_boards = boards(url_by_hand, {})
        for board in known_boards:
            if not is_pointer_driven(board.url):
                raise BoardError(
                    f"{board.url} has positions of its own: `ergon doctor --device {board.url}`"
                )
        hands = open_pointer_hands(known_boards)
    except BoardError as error:
        raise OptionError("hands", str(error)) from None
    server = None
    try:
        if hands.page_pointers:
            server = serve(ANY_LOCAL_PORT, "hands", report, pointers=hands.page_pointers)
            report.say(f"play the keys at {server.url}hands.html")
        for sentence in hands.sentences:
            report.say(sentence)
        _wait_for_hands(hands, measure_seconds, report)
        return [
            describe_arrivals(board, board.pointer)
            for board in hands.boards
            if board.pointer is not None
        ]
    finally:
        if server is not None:
            server.close()
        hands.close()


def _wait_for_hands(hands: PointerHands, measure_seconds: float, report: Report) -> None:
    """Wait until each input has been measured, or has sent nothing for long."""
    pointers = [board.pointer for board in hands.boards if board.pointer is not None]
    report.say(f"move each input for {measure_seconds:g} s")
    start_by_hand: dict[str, float] = {}
    deadline = time.monotonic() + _WAIT_SECONDS_MAX
    while time.monotonic() < deadline:
        instant_now = time.monotonic()
        for pointer in pointers:
            if pointer.name not in start_by_hand and pointer.tally["taken"]:
                start_by_hand[pointer.name] = instant_now
            pointer.discard()  # no performance reads them
        if (
            len(start_by_hand) == len(pointers)
            and instant_now >= max(start_by_hand.values()) + measure_seconds
        ):
            return
        time.sleep(_POLL_SECONDS)
