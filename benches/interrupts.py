"""The time until Ctrl-C ends each command, and the memory that `check` of an arbitrary score
takes.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from benches.measure import Row
from benches.mutated import bases, check, mutated

_ROUNDS = 3
_SCORES = 1000
_PATIENCE = 60.0  # [s]
# Runs a command, and reports on standard output when some thread is in a function of ergon.
CHILD = """
import sys, threading, time
from ergon.cli.app import main

def look():
    looks = 0
    while looks < 3:
        frames = sys._current_frames().values()
        looks = looks + 1 if any(is_in(frame) for frame in frames) else 0
        time.sleep(0.02)
    print("begun", flush=True)

def is_in(frame):
    while frame is not None:
        if frame.f_code.co_name == sys.argv[1] and "ergon" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False

threading.Thread(target=look, daemon=True).start()
main(sys.argv[2:])
"""
# The trial run of this throw would take 1.6e11 frames.
_THROW = """\
ergon: 1
rates: {{audio: 2000kHz}}
keys: {{k: {{M: 400g, f: 90kHz{more}}}}}
players: {{p: {{key: k}}}}
gestures: {{g: 0mm@0s throw 1mm@80000s}}
parts: {{p: [{{at: 0, play: g}}]}}
instruments:
  bell:
    modules: {{m: {{CEL: {{M: 2g, f: 220Hz, t60: 1s}}}}, b: {{BUT: {{between: [k, m], K: 9N/m}}}}}}
    out: {{SOX: m}}
"""
_PLATE = """\
ergon: 1
instruments:
  gong:
    PLATE: {{shape: hex, radius: {radius}, M: 1kg, f: {f}Hz, t60: 9s, hardening: 4e8N/m3}}
    out: {{SOX: gong.centre}}
strikes: {{s: {{to: gong.centre, at: 0, impulse: 1mNs}}}}
render: {{tail: 80000s}}
"""
_LARGE, _LONG = _PLATE.format(radius=400, f=2), _PLATE.format(radius=90, f=80)
_THROWN = _THROW.format(more="")
# The score, the command, and the function in which it is interrupted.
COMMANDS = {
    "check, a rehearsal": (
        _THROW.format(more=", travel: -9mm..9mm"),
        "check score.yaml",
        "_rehearsed_range",
    ),
    "check --simulate": (_THROWN, "check --simulate score.yaml", "measure_excursions"),
    "check, a large plate": (_LARGE, "check score.yaml", "add_parts"),
    "plan": (_THROWN, "plan score.yaml", "plan"),
    "render, its plan": (_THROWN, "render score.yaml -o out.wav", "plan"),
    "render": (_LONG, "render score.yaml -o out.wav --method ca", "frames_of"),
    "render, one thread": (
        _LONG,
        "render score.yaml -o out.wav --threads 1 --method ca",
        "frames_of",
    ),
    "render, a plate of 77,000": (
        _PLATE.format(radius=160, f=30),
        "render score.yaml -o out.wav --method ca",
        "frames_of",
    ),
    "compile": (_THROWN, "compile score.yaml -o out.csv", "stream_ergons"),
    "plot": (_THROWN, "plot score.yaml g --svg out.svg", "wanted_and_actual"),
    "chart": (_LONG, "chart score.yaml -o out", "chart"),
    "stability": ("", "stability -o out", "stability"),
    "info": (_LARGE, "info score.yaml", "info"),
    "fmt": ("", "fmt big.yaml", "fmt"),
}


def begun(folder: Path, what: str) -> subprocess.Popen[str]:
    """A command in its own process, in the middle of work that would take hours."""
    text, command, function = COMMANDS[what]
    (folder / "score.yaml").write_text(text, encoding="utf-8")
    line = [sys.executable, "-c", CHILD, function, *command.split()]
    pipe = subprocess.PIPE
    environment = {**os.environ, "ERGON_CACHE": "off"}
    child = subprocess.Popen(line, cwd=folder, env=environment, stdout=pipe, stderr=pipe, text=True)
    assert child.stdout is not None
    if "begun" not in child.stdout.readline():
        raise ValueError(f"{what}: {child.communicate()}")
    return child


def interrupts() -> list[Row]:
    """Ctrl-C in each command, and scores with some numbers replaced by extreme ones."""
    return [*map(_interrupted, COMMANDS), _memory()]


def _interrupted(what: str) -> Row:
    taken = []
    for _ in range(_ROUNDS):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            big = "".join(f"  g{i}: 0mm@0 smooth 6mm@1/8 0mm@1/4\n" for i in range(300_000))
            if "big.yaml" in COMMANDS[what][1]:
                (folder / "big.yaml").write_text(f"ergon: 1\ngestures:\n{big}")
            with begun(folder, what) as child:
                start = time.perf_counter()
                child.send_signal(signal.SIGINT)
                child.communicate(timeout=_PATIENCE)
                taken.append(1e3 * (time.perf_counter() - start))
            left = sorted(path.name for path in folder.iterdir())
            assert child.returncode == 130, f"{what} ended with {child.returncode}"
            assert set(left) <= {"score.yaml", "big.yaml"}, f"{what} left {left}"
    text = f"{median(taken):.0f} ms, at most {max(taken):.0f} ms"
    values = {"median_ms": median(taken), "most_ms": max(taken)}
    return Row(f"Ctrl-C: {what}", text, "target: 500 ms", max(taken) / 500, "of it", values)


def _memory() -> Row:
    """Peak memory of `check` beyond that of the interpreter and its libraries."""
    import ergon.cli.check
    import ergon.scores.reading.load
    import ergon.scores.staging.stage  # noqa: F401

    texts = list(bases().values())
    peaks = []
    for seed in range(_SCORES):
        result = check(mutated(texts[seed % len(texts)], random.Random(seed)))
        assert result.code in (0, 1, None), result.output
        peaks.append(result.peak / 1e6)
    text = f"at most {max(peaks):.0f} MB, median {median(peaks):.0f} MB"
    values = {"most_mb": max(peaks), "median_mb": median(peaks), "scores": _SCORES}
    scene = f"memory of `check`, {_SCORES:,} scores with extreme numbers"
    return Row(scene, text, "target: 500 MB", max(peaks) / 500, "of it", values)
