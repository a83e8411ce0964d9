"""Whatever numbers a score holds, `check` takes less than 500 MB beyond its network."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest
from sweep import few

from benches.mutated import LIBRARY, bases, mutated

_ENOUGH = 500e6
_STOPWATCH = Path(__file__).parents[2] / "benches" / "stopwatch.py"
_HEAD = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -20mm..20mm}}
players: {p: {key: k}}
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}, b: {BUT: {between: [k, m], K: 900N/m}}}
    out: {SOX: m}
"""
_MANY = "".join(f"  g{i}: 0mm@0 (1mm@1 0mm@2)*200000\n" for i in range(40))


def _play(gesture: str, line: str) -> str:
    return f"{_HEAD}gestures: {{g: {gesture}}}\nparts: {{p: [{{at: 0, play: g{line}}}]}}\n"


# Text, exit code, and what the refusal says.
_SCORES = {
    "a throw of two hours": (_play("0mm@0s throw 0mm@7200s", ""), 0, ""),
    "throws of a day": (_play("0mm@0s throw 0mm@43000s throw 0mm@86000s", ""), 0, ""),
    "occurrences": (_play("0mm@0", ", every: 1/20, times: 1000000"), 1, "more than 200,000 occ"),
    "points": (_play("0mm@0 (1mm@1/9 0mm@2/9)*6", ", every: 2, times: 99999"), 1, "750,000 points"),
    "a long gesture": (_play("0mm@0 (1mm@1/99 0mm@2/99)*249999", ""), 0, ""),
    "gestures": (f"{_HEAD}gestures:\n{_MANY}", 1, "points"),
    "short grains": (_play("{notation: 0mm@0 1mm@1s, grain: 1e-18s}", ""), 0, ""),
    "a grain of a day": (_play("{notation: 0mm@0 1mm@9s, grain: 86000s}", ""), 1, "grain"),
    "rain": (
        _HEAD
        + "strikes:\n"
        + "".join(
            f"  r{i}: {{to: bell.m, at: 0, for: 1s, rate: 1000kHz, impulse: 1uNs}}\n"
            for i in range(9)
        ),
        1,
        "more than 2,000,000",
    ),
}


def _checked(text: str) -> tuple[int, float, str]:
    """Exit code of `check`, its peak memory [bytes] with the interpreter's, and its mistakes."""
    # A small process starts the command: what a fork inherits would count as its peak memory.
    line = [sys.executable, "-I", "-S", str(_STOPWATCH), sys.executable, "-m", "ergon.cli"]
    done = subprocess.run(
        [*line, "check", "-"], input=text, capture_output=True, text=True, cwd=LIBRARY, check=True
    )
    result = json.loads(done.stdout)
    return result["code"], result["memory"] * 2**20, done.stderr


@pytest.mark.parametrize("name", few(_SCORES, ["occurrences", "gestures", "rain"]))
def test_check_memory_with_huge_numbers(name):
    text, code, why = _SCORES[name]
    ended, peak, message = _checked(text)
    assert ended == code, message
    assert why in message
    assert peak < _ENOUGH
    assert "Traceback" not in message


def test_stage_with_long_live_part_is_refused():
    text = (
        _HEAD.replace("{p: {key: k}}", "{p: {key: k, hand: live, standin: t}}")
        + "takes: {t: {file: takes/hand-point-2.csv, channel: x}}\n"
        + "parts: {p: [{at: 0, play: t, times: 40000, do: [stretch 10]}]}\n"
    )
    from ergon.scores.reading.load import load
    from ergon.scores.staging.refusals import StageError
    from ergon.scores.staging.stage import stage

    piece = load(LIBRARY / "s.yaml", text=text).piece
    assert piece is not None
    with pytest.raises(StageError) as refused:
        stage(piece, real_hands={"p": None})
    assert "with ticks of" in refused.value.diagnostics[0].message


@pytest.mark.parametrize("seed", few(range(12), 4))
def test_check_memory_with_random_numbers(seed):
    texts = [*bases().values()]
    text = texts[seed % len(texts)]
    ended, peak, message = _checked(mutated(text, random.Random(1000 * seed)))
    assert ended in (0, 1), message
    assert peak < _ENOUGH
    assert "Traceback" not in message
