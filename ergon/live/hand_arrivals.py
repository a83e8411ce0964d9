"""How positions arrive from the inputs of keys without a device, and what delay they need."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .boards import PAGE_KINDS
from .fitness import TICK_SECONDS, Finding, duration_text
from .pointer_address import PointerAddress, parse_pointer_address

if TYPE_CHECKING:
    from ergon import _core

    from .boards import Board

_POSITIONS_MIN = 20  # positions from which quantiles are stated
_STAMPED_KINDS = (*PAGE_KINDS, "gamepad")  # kinds whose positions say when they were taken
_USUAL_SHARE = 0.999  # share of positions in time with the advised delay
_DELAY_RATIO_MAX = 2.0  # a delay so many times the needed one is longer than useful


def describe_arrivals(board: Board, pointer: _core.Lead) -> Finding:
    """What came for a key: rate, jitter, time on the way, and the delay of the path that fits."""
    address = parse_pointer_address(board.url)
    tally = pointer.tally
    n_positions = int(tally["taken"])
    gaps, wait_times, needed_delays = zip(
        *(pointer.arrival_times(probability) for probability in (0.5, 0.99, 1.0)), strict=True
    )
    _, _, needed_delay = pointer.arrival_times(_USUAL_SHARE)
    arrival_figures: dict[str, object] = {
        "url": board.url,
        "taken": n_positions,
        "refused": int(tally["refused"]),
        "misdated": int(tally["misdated"]),
        "gap_s": tally["gap"],
        "gap_deviation_s": tally["deviation"],
        "gap_p99_s": gaps[1],
        "gap_max_s": gaps[2],
        "wait_p50_s": wait_times[0] if address.kind in _STAMPED_KINDS else None,
        "wait_p99_s": wait_times[1] if address.kind in _STAMPED_KINDS else None,
        "need_max_s": needed_delays[2],
        "delay_s": address.delay,
    }
    board_name = board.display_name
    if n_positions < _POSITIONS_MIN:
        finding_sentence = (
            f"{board_name}: {n_positions} positions came, and {_POSITIONS_MIN} are needed "
            "to measure"
        )
        return Finding(
            "hands", finding_sentence, "move it all the time while it is measured", arrival_figures
        )
    rate = 1.0 / tally["gap"] if tally["gap"] else 0.0
    finding_sentence = (
        f"{board_name}: {rate:.0f} positions a second while it moves, one each "
        f"{tally['gap'] * 1e3:.1f} ms ± {tally['deviation'] * 1e3:.1f} ms, p99 "
        f"{duration_text(gaps[1])}; "
    )
    if address.kind in _STAMPED_KINDS:
        finding_sentence += (
            f"on the way for {duration_text(wait_times[0])}, p99 {duration_text(wait_times[1])}; "
        )
    else:
        finding_sentence += "nothing says when they were taken; "
    force_delay = address.delay + TICK_SECONDS
    finding_sentence += f"{duration_text(force_delay)} from a position to the force on the finger"
    return Finding(
        "hands",
        finding_sentence,
        _advice(address, needed_delay, int(tally["refused"])),
        arrival_figures,
    )


def _advice(address: PointerAddress, needed_delay: float, n_refused: int) -> str:
    """What to do; empty where the delay of the path is as long as it has to be."""
    rounded_delay = 1e-3 * -(-needed_delay // 1e-3)  # rounded up to a millisecond
    advice = []
    if needed_delay > address.delay:
        advice.append(f"positions come late for its path: ?delay={rounded_delay * 1e3:.0f}ms")
    elif rounded_delay * _DELAY_RATIO_MAX < address.delay:
        advice.append(f"they come early enough for ?delay={rounded_delay * 1e3:.0f}ms")
    if n_refused:
        advice.append(f"{n_refused:,} positions were refused, which are no numbers or too many")
    return "; ".join(advice)
