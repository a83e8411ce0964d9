"""Scores with some of their numbers replaced by extreme ones, and `check` of each in its own
process.
"""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path

LIBRARY = Path(__file__).parent.parent / "scores" / "library"
# A score that uses features that the library's scores do not use.
WIDE = """\
ergon: 1
seed: 3
rates: {audio: 44100Hz, gesture: 4410Hz}
tempo: [{at: 1|1, bpm: 60, meter: 4/4}, {at: 3|1, bpm: 60 -> 96, over: 2bar}]
marks: {A: 1|1, B: 3|1}
keys:
  k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -20mm..20mm}
  lever: {M: 300g, f: 2Hz, t60: 1s, reach: 2}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}
      b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}}
    out: {SOX: m}
  wire: {STRING: {masses: 24, M: 20g, f: 110Hz, t60: 2s}, out: {SOX: wire.3}}
  skin: {PLATE: {shape: hex, radius: 3, M: 60g, f: 80Hz, t60: 1s}, out: {SOX: skin.centre}}
  sky: {BANK: {count: 40, f: 100Hz..4kHz, t60: 0.5s..2s, M: 20mg}, out: {SOX: sky.all}}
gestures:
  knock: {notation: 0mm@0 smooth 6mm@1/8 throw 0mm@1/2, grain: 20ms}
  long: 0mm@0s smooth 3mm@1s throw 0mm@4s
  roll: {notation: 0mm@0 (2mm@1/8 0mm@1/4)*6, join: 20ms}
strikes:
  rain: {to: sky.all, at: A, for: 2bar, rate: 0.2Hz, impulse: 1uNs..9uNs}
  hail: {to: skin.centre, at: 1, every: 1/2, times: 6, impulse: 1mNs}
  once: {to: wire.5, at: 0.5s, mass: 2g, speed: 0.5m/s}
players:
  p: {key: k}
  q: {hand: live, key: lever, standin: roll, tick: 1kHz}
parts:
  p:
    - {at: A, play: knock, every: 1, times: 4}
    - {at: B, play: roll, every: 2bar, until: 9|1, do: [jitter 4ms 0.2mm, stretch 2]}
    - {at: 20, play: long}
mix: {channels: 2, route: [{from: bell, to: [1, 2], gain: -3dB, highpass: 40Hz}]}
render: {bits: 24, tail: 2s}
accuracy: {error: -60dB}
"""
# Replacements for a number; a unit that follows it stays.
EXTREMES = ("0", "-1", "1e-9", "7", "3600", "100000", "86399", "1e6", "9999999", "1e9", "1e18")
UNITS = ("7200s", "86000s", "1e9s", "1ms", "2MHz", "1kHz", "0.001Hz", "1000000bar", "-60dB")
_NUMBER = re.compile(r"(?<![\w.|+/-])\d+(?:\.\d+)?(?:e\d+)?")


def bases() -> dict[str, str]:
    """The scores that are mutated, by name."""
    scores = {path.name: path.read_text("utf-8") for path in sorted(LIBRARY.glob("*.yaml"))}
    scores.pop("hand.yaml", None)
    return {"wide.yaml": WIDE, **scores}


def mutated(text: str, chance: random.Random) -> str:
    """The text with one to three of its numbers replaced."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        places = [result for result in _NUMBER.finditer(text) if _is_value(text, result.start())]
        result = chance.choice(places)
        stop = result.end()
        if chance.random() < 0.3:
            new = chance.choice(UNITS)
            stop += len(re.match(r"[A-Za-z%/]*", text[stop:])[0])  # type: ignore[index]
        else:
            new = chance.choice(EXTREMES)
        text = text[: result.start()] + new + text[stop:]
    return text


def _is_value(text: str, offset: int) -> bool:
    """Whether a number is neither the version nor in a comment."""
    line = text[text.rfind("\n", 0, offset) + 1 : offset]
    return "#" not in line and not line.startswith("ergon:")


@dataclass(frozen=True)
class Checked:
    """The end of a `check` in its own process: code, peak memory [bytes], time [s]."""

    code: int | None
    peak: int
    seconds: float
    output: str


def check(text: str, folder: Path = LIBRARY, *, patience: float = 60.0) -> Checked:
    """Check a score in a forked process; `code` is None if it took longer than `patience`.

    `peak` is the memory that the process took beyond what it began with.
    """
    sys.stdout.flush()
    output, tell = os.pipe()
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.dup2(tell, 1)
            os.dup2(tell, 2)
            os.close(output)
            code = _checked(text, folder)
        finally:
            sys.stdout.flush()
            os._exit(code)
    os.close(tell)
    message = bytearray()
    os.set_blocking(output, False)
    peak, ended = 0, None
    while ended is None and time.monotonic() - began < patience:
        peak = max(peak, _peak(child))
        _drain(output, message)
        pid, status = os.waitpid(child, os.WNOHANG)
        ended = os.waitstatus_to_exitcode(status) if pid else None
        time.sleep(0.002)
    if ended is None:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    _drain(output, message)
    os.close(output)
    return Checked(
        ended, _reported_peak(message) or peak, time.monotonic() - began, message.decode()
    )


def _checked(text: str, folder: Path) -> int:
    import io

    from ergon.cli.app import run

    sys.stdin = io.TextIOWrapper(io.BytesIO(text.encode()))
    os.chdir(folder)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    code = run(["check", "-"])
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"\npeak {(after - before) * 1024}", flush=True)
    return code


def _reported_peak(output: bytearray) -> int:
    peak_line = re.search(rb"\npeak (\d+)\n$", output)
    return int(peak_line[1]) if peak_line else 0


def _peak(child: int) -> int:
    try:
        status = Path(f"/proc/{child}/status").read_text()
    except OSError:
        return 0
    result = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(result[1]) * 1024 if result else 0


def _drain(pipe: int, into: bytearray) -> None:
    try:
        while data := os.read(pipe, 65536):
            into += data
    except BlockingIOError:
        pass
