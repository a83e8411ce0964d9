"""Two keys in other processes, by the wall clock, for minutes: late ticks and gaps in the sound.

A virtual machine is sometimes stopped by its host: a bare loop beside the duet shows how often.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from benches.beside import Bare, bare
from benches.measure import Row
from benches.native import Loops

ERGON = [sys.executable, "-m", "ergon.cli"]
_BLOCK = 256  # frames
_BOARD_PRIORITY = 40  # SCHED_FIFO, below the thread that waits for the board
_AHEAD = 4096  # frames kept ready for the card: what `ergon doctor` advises on a machine like this
_TARGETS = {
    "UDP": "target: no gaps, below 0.1 %",
    "pty": "no target: the kernel hands its bytes on",
}
_HAND = "0mm@0 (smooth 7mm@1 0mm@2)*{times}"
_SCORE = """\
ergon: 1
use: [instruments/gong.yaml]
keys: {{k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}, k2: {{like: k1}}, v: {{like: k1}}}}
instruments:
  gong: {{from: gong/plate, f: A1, t60: 8s}}
  {beside}
  action:
    modules:
      a: {{BUT: {{between: [k1, gong.centre], K: 150N/m, gap: 1mm}}}}
      b: {{BUT: {{between: [k2, gong.centre], K: 150N/m, gap: 1mm}}}}
      c: {{BUT: {{between: [v, gong.centre], K: 600N/m, gap: 1mm}}}}
gestures: {{knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}}
players: {{ada: {{hand: live, key: k1}}, remi: {{hand: live, key: k2}}, leo: {{key: v}}}}
duet: [{{couple: [k1, k2], REF: {{K: 20N/m, Z: 0.2Ns/m}}}}]
parts: {{leo: [{{at: 1|1, play: knock, every: 1, times: {times}}}]}}
render: {{tail: 500ms}}
"""


def duet(loops: Loops | None, minutes: float = 1.0) -> list[Row]:
    """A duet at 1,002 Hz over UDP, and the same over pseudo-terminals beside it."""
    return [
        _played("UDP", ("--udp", "0"), minutes, loops),
        _played("UDP", ("--udp", "0"), minutes, loops, ahead=_AHEAD),
        _played("pty", ("--pty",), minutes, loops),
    ]


def _played(
    wire: str,
    method: tuple[str, ...],
    minutes: float,
    loops: Loops | None,
    ahead: int | None = None,
) -> Row:
    seconds = round(60 * minutes)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as keys:
        score = written(Path(folder), seconds)
        first, second = (keys.enter_context(key(seconds, *method)) for _ in range(2))
        live = ("--live", f"ada={first}", "--live", f"remi={second}")
        audio = ("--audio", f"null,block={_BLOCK}", "--gain", "0dB", "--unchecked", "--json")
        ready = () if ahead is None else ("--ahead", str(ahead))
        command = [*ERGON, "duet", str(score), *live, *audio, *ready]
        output, beside = _duet_result(command, loops)
    gaps = output["underruns"] + (output["dropped"] > 0)
    late = output["late_ticks"] / output["ticks"]
    saved = "" if ahead is None else f", {ahead:,} kept ready"
    return Row(
        f"a duet of two keys over {wire} at 1,002 Hz, {_BLOCK} frames a block{saved}, {seconds} s",
        f"{gaps} gaps, {late:.3%} of ticks late",
        f"{beside or 'no bare loop without Linux and a C compiler'}; {_TARGETS[wire]}",
        beside and beside.ratio(late),
        "late ticks over the bare loop's",
        {
            "gaps": gaps,
            "late": late,
            "ticks": output["ticks"],
            "dropped": output["dropped"],
            **{f"bare_{name}": value for name, value in (asdict(beside) if beside else {}).items()},
        },
    )


def _duet_result(command: list[str], loops: Loops | None) -> tuple[dict[str, int], Bare | None]:
    """The result of a duet, and a bare loop that ran during it."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        last = process.stdout.readline()  # it plays
        with bare(loops) as beside:
            for line in process.stdout:
                last = line
    assert process.returncode == 0, f"{command} ended with {process.returncode}"
    return json.loads(last), beside


def written(folder: Path, seconds: int, beside: str = "") -> Path:
    """The score of a duet that lasts `seconds` [s], with an instrument `beside` (a line of
    YAML).
    """
    score = folder / "duet.yaml"
    score.write_text(_SCORE.format(times=seconds, beside=beside))
    return score


def _as_a_board() -> None:
    """Use real-time priority if it is granted: the load of this machine does not slow a real board
    either.
    """
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_BOARD_PRIORITY))


@contextmanager
def key(seconds: int, *method: str) -> Iterator[str]:
    """An emulated key with a hand on it that plays for `seconds` [s]; yields its URL."""
    hand = ("--gesture", _HAND.format(times=seconds // 2 + 10), "--hand", "900N/m")
    command = [*ERGON, "emulate", "frame", *method, *hand, "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, text=True, preexec_fn=_as_a_board) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["url"]
        finally:
            process.terminate()
