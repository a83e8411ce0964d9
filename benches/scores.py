"""Long scores for `ergon check`, generated: every value is plausible, no two lines are alike."""

from __future__ import annotations

_HEAD = """\
ergon: 1
title: {title}
seed: 7
keys: {{k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
instruments:
  bell:
    modules:
      m: {{CEL: {{M: 2g, f: 220Hz, t60: 2.5s}}}}
      b: {{BUT: {{between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}}}
    out: {{SOX: m}}
players: {{ada: {{key: k1}}}}
mix: {{route: [{{from: bell, to: 1}}]}}
"""


def entries(n: int) -> str:
    """A score of `n` YAML entries: a tenth marks, three tenths gestures, the others of a part."""
    lines = [_HEAD.format(title=f"{n} entries"), "marks:"]
    n_marks, n_gestures = n // 10, 3 * n // 10
    n_plays = n - n_marks - n_gestures
    lines += [f"  m{i}: {1 + i // 4}|{1 + i % 4}" for i in range(n_marks)]
    lines.append("gestures:")
    lines += [
        f"  g{i}: 0mm@0 smooth {2 + i % 7}.{i % 10}mm@1/8 {i % 3}mm@1/4 0mm@1/2"
        for i in range(n_gestures)
    ]
    lines += ["parts:", "  ada:"]
    for i in range(n_plays):
        extra = (", do: [scale 0.5]", ", touch: open", "")[i % 3]
        lines.append(f"    - {{at: {1 + i // 4}|{1 + i % 4}, play: g{i % n_gestures}{extra}}}")
    return "\n".join(lines) + "\n"


def points(n: int) -> str:
    """A score with one gesture of `n` rows, 10 ms apart."""
    lines = [_HEAD.format(title=f"{n} points"), "gestures:", "  long:", "    points: |"]
    lines += [f"      {i * 0.01:.2f}s  {(i * 37 % 101) * 0.02:.2f}mm" for i in range(n)]
    lines += ["parts:", "  ada:", "    - {at: 1|1, play: long}"]
    return "\n".join(lines) + "\n"


def rows(n: int) -> str:
    """A score whose part is a table of `n` rows."""
    lines = [_HEAD.format(title=f"{n} rows"), "gestures:"]
    lines += [f"  g{i}: 0mm@0 smooth {2 + i % 7}mm@1/32 0mm@1/8" for i in range(16)]
    lines += ["parts:", "  ada: |"]
    lines += [f"    {1 + i // 32}|{1 + i % 32 / 8}  g{i % 16}" for i in range(n)]
    return "\n".join(lines) + "\n"


def times(n: int) -> str:
    """A score in which one entry plays a gesture `n` times."""
    lines = [_HEAD.format(title=f"{n} times"), "gestures:"]
    lines += ["  knock: 0mm@0 smooth 6mm@1/8 0mm@1/4", "parts:", "  ada:"]
    lines += [f"    - {{at: 1|1, play: knock, every: 1/4, times: {n}, do: [jitter 4ms 0.2mm]}}"]
    return "\n".join(lines) + "\n"


def strikes(n: int) -> str:
    """A score with `n` strikes at a constant distance on a bank, and a rain of about as many."""
    lines = [
        _HEAD.format(title=f"{n} strikes").replace(
            "players:",
            "  sky:\n    BANK: {count: 100, f: 20Hz..10kHz, t60: 0.5s..8s, M: 1g}\n"
            "    out: {SOX: sky.all}\nplayers:",
        ),
        "strikes:",
        f"  hail: {{to: sky.3, at: 1|1, every: 1/8, times: {n}, impulse: 1uNs..4uNs}}",
        f"  rain: {{to: sky.all, at: 1|1, for: {n // 100}s, rate: 1Hz, impulse: 1uNs..4uNs}}",
    ]
    return "\n".join(lines) + "\n"
