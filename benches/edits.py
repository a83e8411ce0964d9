"""The cost of an edit: a second render of four minutes, one gesture in the last third changed."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

from benches.fresh_process import ergon
from benches.measure import Row

# A gong that hardens, a bowed string and a bell; their players share no instrument.
_SCORE = """\
ergon: 1
title: Four minutes
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}]
keys:
  k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}
  k2: {{like: k1}}
  k3: {{like: k1}}
instruments:
  gong:
    modules:
      p: {{PLATE: {{shape: hex, radius: 6, M: 400g, f: 180Hz, t60: 6s, hardening: 1e9N/m3}}}}
      b: {{BUT: {{between: [k1, p.centre], K: 4kN/m, Z: 2Ns/m, gap: 2mm}}}}
    out: {{SOX: p.20}}
  wire:
    modules:
      s: {{STRING: {{masses: 48, M: 6g, f: D3, t60: 3s, hardening: 1e8N/m3}}}}
      b: {{BUT: {{between: [k2, s.9], K: 2kN/m, Z: 1Ns/m, gap: 2mm}}}}
    out: {{SOX: s.40}}
  bell:
    modules:
      m: {{PLATE: {{shape: square, radius: 4, M: 200g, f: 420Hz, t60: 4s}}}}
      b: {{LNL: {{between: [k3, m.0], law: "-k*max(-d, 0)**2.5", k: 4e5}}}}
    out: {{SOX: m.centre}}
{joined}gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
  lean: 0mm@0 smooth 4mm@1/4 smooth 0mm@3/4
players: {{ada: {{key: k1}}, remi: {{key: k2}}, mia: {{key: k3}}}}
parts:
  ada: [{{at: 1|1, play: knock, every: 2, times: 118}}]
  remi: [{{at: 1|2, play: lean, every: 2, times: 118}}]
  mia:
    - {{at: 1|3, play: knock, every: 3, times: 57}}
    - {{at: 44|3, play: {edited}}}
    - {{at: 46|1, play: lean, every: 3, times: 18}}
mix: {{channels: 2, route: [{{from: gong, to: 1}}, {{from: wire, to: 2}}, {{from: bell, to: 1}}]}}
render: {{tail: 2s}}
"""
# A frame from which all of them hang: then they are one island, and each edit affects all of them.
_FRAME = """\
  frame:
    modules:
      r: {REF: {between: [gong.p.3, wire.s.2], K: 200N/m, Z: 0.02Ns/m}}
      t: {REF: {between: [wire.s.46, bell.m.3], K: 200N/m, Z: 0.02Ns/m}}
"""


def edits() -> list[Row]:
    """One row for each piece."""
    return [_edited("three instruments", ""), _edited("three joined ones", _FRAME)]


def _edited(what: str, joined: str) -> Row:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, rendered = _rendered(folder, joined, "knock", "cache")
        again, _ = _rendered(folder, joined, "knock", "cache")
        edited, resumed = _rendered(folder, joined, "lean", "cache")
        scratch, complete = _rendered(folder, joined, "lean", "another")
    assert rendered != resumed == complete, "an edit renders to the bytes of a render from scratch"
    return Row(
        f"render of four minutes, {what}, one gesture in the last third changed (target 20 %)",
        f"{edited:.1f} s of CPU time; nothing changed: {again:.1f} s",
        f"from scratch: {scratch:.1f} s",
        edited / scratch,
        "of the time from scratch",
        {"cpu_s": edited, "again_s": again, "first_s": first, "scratch_s": scratch},
    )


def _rendered(folder: Path, joined: str, edited: str, cache: str) -> tuple[float, str]:
    """CPU time of `ergon render` [s], and the hash of the file."""
    (folder / "a.yaml").write_text(_SCORE.format(edited=edited, joined=joined), encoding="utf-8")
    variables = {"XDG_CACHE_HOME": str(folder / cache), "ERGON_CACHE": "on"}
    spent, result = ergon(["render", "a.yaml", "-o", "a.wav", "-f"], folder, variables)
    result.check_returncode()
    return spent, hashlib.sha256((folder / "a.wav").read_bytes()).hexdigest()
