"""The cost of planning after an edit: a piece of five players, of which one entry is changed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from benches.fresh_process import ergon
from benches.measure import Row

# A gong, a bow, two strings that rattle, a bell by a law, and 500 resonators.
_SCORE = """\
ergon: 1
title: Five players
use: [instruments/friction.yaml]
tempo: [{at: 1|1, bpm: 60, meter: 4/4}]
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  k2: {like: k1}
  k3: {like: k1}
  k4: {like: k1}
  k5: {like: k1}
  bow: {M: 200g, K: 0.5N/m, Z: 0.2Ns/m}
instruments:
  gong:
    modules:
      p: {PLATE: {shape: hex, radius: 7, f: F2, t60: 20s, M: 300g, rim: fixed, hardening: 1e9N/m3}}
      b: {BUT: {between: [k1, p.centre], K: 4kN/m, Z: 2Ns/m, gap: 2mm}}
    out: {SOX: p.20}
  gamba:
    from: friction/viol
    modules: {hair: {LNL: {between: [bow, body.8], damping: bow, F: 1N, a: 60}}}
  wire:
    modules:
      s: {STRING: {masses: 48, M: 6g, f: D3, t60: 5s}}
      nut: {MAS: {M: 1g}}
      r: {BUT: {between: [nut, s.30], K: 6e5N/m, Z: 0.02Ns/m, gap: 30um}}
      h: {REF: {between: [nut, s.31], K: 40N/m, Z: 0.01Ns/m}}
      b: {BUT: {between: [k2, s.9], K: 2kN/m, Z: 1Ns/m, gap: 2mm}}
    out: {SOX: s.40}
  snare:
    modules:
      s: {STRING: {masses: 40, M: 5g, f: A3, t60: 3s, hardening: 1e8N/m3}}
      w: {SOL: {}}
      r: {BUT: {between: [w, s.20], K: 3e5N/m, Z: 0.02Ns/m, gap: 50um}}
      b: {BUT: {between: [k3, s.7], K: 2kN/m, Z: 1Ns/m, gap: 2mm}}
    out: {SOX: s.33}
  bell:
    modules:
      m: {PLATE: {shape: square, radius: 4, M: 200g, f: 420Hz, t60: 4s}}
      b: {LNL: {between: [k4, m.0], law: "-k*max(-d, 0)**2.5", k: 4e5}}
    out: {SOX: m.centre}
  sky:
    BANK: {count: 500, f: 80Hz..10kHz, spread: random, t60: 0.5s..8s, M: 1g, place: spiral}
    out: {SOX: sky.all}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
  lean: 0mm@0 smooth 4mm@1/4 smooth 0mm@3/4
  draw: 0mm@0 line 450mm@3s 450mm@3.4s -90mm@6.4s smooth 0mm@8s
players: {ada: {key: k1}, remi: {key: k2}, mia: {key: k3}, noa: {key: k4}, ivo: {key: bow}}
parts:
  ada: [{at: 1|1, play: knock, every: 2, times: 28}]
  remi: [{at: 1|2, play: lean, every: 2, times: 28}]
  mia: [{at: 1|3, play: knock, every: 3, times: 17}, {at: 14|3, play: lean}]
  noa: [{at: 2|1, play: knock, every: 3, times: 18}]
  ivo:
    - {at: 2|1, play: draw, touch: tracked}
    - {at: 5|1, play: draw, touch: tracked, do: [mirror]}
    - {at: 9|1, play: draw, touch: tracked}
strikes:
  rain: {to: sky.all, at: 3|1, for: 10bar, rate: 0.02Hz, impulse: 1uNs..9uNs}
render: {tail: 4s}
"""
# The edits: an entry after the beginning of each instrument, the resonators, and beginnings.
_EDITS = {
    "an entry of the gong": ("every: 2, times: 28}]\n  remi", "every: 2, times: 20}]\n  remi"),
    "an entry of the rattling string": ("lean, every: 2, times: 28}", "lean, every: 2, times: 20}"),
    "an entry of the snare": ("{at: 14|3, play: lean}", "{at: 14|1, play: knock}"),
    "an entry of the bell": ("every: 3, times: 18}", "every: 3, times: 17}"),
    "an entry of the bow": ("{at: 9|1, play: draw", "{at: 9|2, play: draw"),
    "the resonators": ("1uNs..9uNs", "1uNs..8uNs"),
    "the first entry of the gong": ("ada: [{at: 1|1, play: knock", "ada: [{at: 1|1, play: lean"),
    "the first entry of the bow": ("- {at: 2|1, play: draw", "- {at: 2|2, play: draw"),
}


def replan() -> list[Row]:
    """One row for each edit."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _planned(folder, _SCORE, "on")
        for what, (old, new) in _EDITS.items():
            assert _SCORE.count(old) == 1
            edited = _SCORE.replace(old, new)
            saved, plan = _planned(folder, edited, "on")
            complete, scratch = _planned(folder, edited, "off")
            assert plan == scratch, "a plan after an edit is that from scratch"
            rows.append(
                Row(
                    f"plan of five players, {what} changed (target 1 s)",
                    f"{saved:.2f} s of CPU time, start of the program and reading included",
                    f"from scratch: {complete:.2f} s",
                    saved / complete,
                    "of the time from scratch",
                    {"cpu_s": saved, "scratch_s": complete},
                )
            )
    return rows


def _planned(folder: Path, text: str, cache: str) -> tuple[float, str]:
    """CPU time of `ergon plan` [s], and the plan with all its rows."""
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    variables = {"XDG_CACHE_HOME": str(folder / "cache"), "ERGON_CACHE": cache}
    spent, result = ergon(["plan", "a.yaml"], folder, variables)
    result.check_returncode()
    table, _, last = result.stdout.rpartition("\n\n")
    return spent, table + last.rpartition(";")[2]
