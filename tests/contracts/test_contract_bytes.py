"""Same score, same bytes: the command itself, a process for each way of running it.

The score uses everything that could go astray: chance, a take through its low-pass, a bank drawn at
random, contacts with powers, a law with exp, two players, limiter and high-pass, 16 bits.
"""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ERGON
from sweep import few

from tests.contracts.test_determinism import PLAIN_GLIBC, disabled

TAKE = Path(__file__).parents[2] / "scores/library/takes/hand-point-1.csv"
SCORE = f"""\
ergon: 1
title: All that could go astray
seed: 3
tempo: [{{at: 1|1, bpm: 120 -> 171, over: 3}}]
keys:
  k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}
  k2: {{like: k1, M: 300g}}
instruments:
  sky:
    BANK: {{count: 40, f: 200Hz..5kHz, spread: random, t60: 0.1s..1s, M: 1g}}
    out: {{SOX: sky.all}}
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: A4+13cents, t60: 0.4s}}}}
      n: {{CEL: {{M: 3g, f: 700Hz, t60: 0.4s}}}}
      a: {{BUT: {{between: [k1, m], K: 2e5, exponent: 1.5, Z: 0.1Ns/m, gap: 1mm}}}}
      b: {{BUT: {{between: [k2, n], K: 2e5, exponent: 1.5, contact: exact, gap: 2mm}}}}
      l: {{LNL: {{between: [m, n], law: "F*d/w*exp(0.5 - 0.5*(d/w)**2)", F: 1N, w: 1mm}}}}
    out: {{SOX: [m, n]}}
gestures:
  knock: 0mm@0 smooth 3mm@1/8 0mm@1/4 throw 2mm@3/8 smooth 0mm@5/8
takes:
  hand: {{file: {TAKE}, trim: 1s..2.5s, smooth: 9Hz}}
players: {{ada: {{key: k1}}, remi: {{key: k2}}}}
parts:
  ada: [{{at: 1|1, play: knock, times: 3, do: [jitter 4ms 0.2mm]}}]
  remi: [{{at: 1|1, play: hand, do: [scale 0.7, stretch 1/3]}}]
strikes:
  rain: {{to: sky.all, at: 0, for: 2, rate: 3Hz, impulse: 1uNs..4uNs}}
mix:
  channels: 2
  route: [{{from: bell, to: [1, 2]}}, {{from: sky, to: 2, gain: 20dB, highpass: 300Hz}}]
  master: {{normalise: -1dB, limit: -3dB}}
render: {{bits: 16, tail: 0.2s}}
"""


def rendered(folder: Path, text: str, *options: str, **environment: str) -> str:
    """SHA-256 of the file that `ergon render` writes in a process of its own."""
    score, target = folder / "piece.yaml", folder / "piece.wav"
    score.write_text(text, encoding="utf-8")
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        [*ERGON, "render", "-q", str(score), *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    written = target.read_bytes()
    target.unlink()
    assert len(written) > 40_000
    return hashlib.sha256(written).hexdigest()


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> str:
    return rendered(tmp_path_factory.mktemp("reference"), SCORE)


@pytest.mark.parametrize(
    ("threads", "block"), few([(1, 64), (2, 7), (1, 997), (2, 997)], [(2, 997)])
)
def test_render_bytes_with_threads_and_blocks(tmp_path: Path, reference: str, threads, block):
    options = ("--threads", str(threads), "--block", str(block))
    assert rendered(tmp_path, SCORE, *options) == reference


@pytest.mark.parametrize(
    "tunables", few(["glibc.cpu.hwcaps=-AVX2,-FMA", PLAIN_GLIBC], [PLAIN_GLIBC])
)
def test_render_bytes_without_cpu_features(tmp_path: Path, reference: str, tunables: str):
    environment = {"GLIBC_TUNABLES": tunables}
    if off := disabled():
        environment["NPY_DISABLE_CPU_FEATURES"] = off
    assert rendered(tmp_path, SCORE, "--threads", "1", **environment) == reference


def test_render_bytes_with_comments_and_other_units(tmp_path: Path, reference: str):
    same = SCORE.replace("seed: 3\n", "seed: 3  # drawn by lot\n").replace("400g", "0.4kg")
    assert same != SCORE
    assert rendered(tmp_path, same) == reference


@pytest.mark.slow
def test_render_bytes_differ_with_seed(tmp_path: Path, reference: str):
    assert rendered(tmp_path, SCORE.replace("seed: 3\n", "seed: 4\n")) != reference
