"""The page of faults and of the time until the force then ends, made by `ergon doctor --safety`."""

from __future__ import annotations

from pathlib import Path

from ergon.common.module_arguments import module_arguments
from ergon.live import faults

_HEAD = """\
# Faults, and how soon a force ends

Made by `make docs` from `ergon doctor --safety`, which prints the same table and exits with 1
when a force exceeds its bound.

Each fault is made on each emulated device while a piece pulls a key by a spring and a hand of 400
N/m and 4 N·s/m holds it: a key in the program itself (`emul`), a board of the open frame
(`frame`, 20 N), a FireFader (1.56 N) and Haply's service with its guardian (10 N). Time is
virtual. The host ticks once a millisecond, and a board's time goes in steps of 0.125 ms; no clock
is read, so that every machine shows the same figures. The drivers, the bytes, the boards'
programs, the guardian's rules and every stage a force passes ([playing
live](live.md#the-stages-of-a-force)) are those that play; serial ports, sockets, WebSockets and
processes are left out. What those add is measured by the clock ([safety](safety.md)). No real
board has been measured yet.

A figure is the time from the fault, which begins right after a packet went out, until the motor
gives no force.

"""
_TAIL = """
Besides, from the fault on no force is greater than the device's greatest, and none grows faster
than the slew limit (a fifth of the greatest force in a millisecond); a board whose line carries
no checksum may read any force from garbage. A motor that turns round reaches the greatest force
before it is found out, where the piece's spring is stronger than the hand. The direction of a
device that was never calibrated is tried by a fifth of the greatest force at most.

The bounds of a motor and of a sensor are those of the rules in [playing
live](live.md#force-and-motion-that-disagree): figures of one moment are below them. A second
emulation makes the same faults at random moments under six hands
([safety](safety.md#faults-at-random)).
"""


def page() -> str:
    """The page, as Markdown."""
    rows = faults.measure_faults()
    devices = [f"`{cell.device}`" for cell in rows[0].results]
    lines = [f"| fault | bound | {' | '.join(devices)} |", f"|---|---|{'---|' * len(devices)}"]
    for row in rows:
        cells = [cell.said for cell in row.results]
        lines.append(f"| {row.fault} | {faults.bounds_text(row)} | {' | '.join(cells)} |")
    return _HEAD + "\n".join(lines) + "\n" + _TAIL


def main() -> None:
    """Write the page to the given path."""
    Path(module_arguments("PAGE")[0]).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
