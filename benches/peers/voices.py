"""Voices of physical models in Csound and Faust, and the processor time that they take."""

from __future__ import annotations

import re
import resource
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benches.peers import Missing, command, faust, program_path
from benches.voice_cost import Voices, counted

RATE, BLOCK = 44100, 256
SHORT, LONG = 1.0, 4.0  # seconds of sound
_FAUST_VOICES = 32
_MODELS = ("ks", "guitar", "marimba", "churchBell", "djembe", "violinModel", "clarinetModel")


@dataclass(frozen=True, slots=True)
class Opcode:
    """Lines that leave the sound in `a1`; whether each stroke is a note; how many voices play."""

    lines: str
    is_struck: bool
    voices: int


# Pitches are those of ergon's instruments of the kind: guitar, marimba, piano, viol and reed.
_OPCODES = {
    "pluck": Opcode("a1 pluck 0.3, 164.81, 164.81, 0, 1", True, 128),
    # iK is that of a bar at F3, clamped as in the manual: a free one drifts away.
    "barmodel": Opcode("a1 barmodel 1, 1, 44.4, 0.001, 0.23, 0.7, 0.3, 500, 0.05", True, 32),
    # Two strings: with one, 6.18 falls silent after 0.1 s.
    "prepiano": Opcode(
        "a1 prepiano 130.8, 2, 2, 1, 3, 0.002, 2, 2, 1, 500, -0.01, 0.09, 60, 0, 0.1", True, 8
    ),
    "wgbow": Opcode("a1 wgbow 0.3, 146.83, 3, 0.127, 0, 0", False, 64),
    "wgclar": Opcode("a1 wgclar 0.3, 146.83, -0.3, 0.1, 0.1, 0.2, 0, 0", False, 64),
}
_MODES_IN_ALL = 1500


def _modes(count: int) -> Opcode:
    """Oscillators from 100 Hz to 12 kHz that an impulse excites twice a second."""
    pitches = [100.0 * (120.0 ** (i / count)) for i in range(count)]
    lines = ["astart mpulse 0.3, 0.5", "a1 = 0"]
    for pitch in pitches:
        lines += [f"amode mode astart, {pitch:.2f}, {3 * pitch:.1f}", "a1 += amode"]
    return Opcode("\n  ".join(lines), False, max(1, _MODES_IN_ALL // count))


def csound(name: str) -> Voices:
    """Voices of an opcode, `mode × 5` being five in a voice; raises Missing."""
    program = program_path("csound", "csound")
    kind, _, count = name.partition(" × ")
    opcode = _modes(int(count)) if kind == "mode" else _OPCODES[kind]
    folder = tempfile.TemporaryDirectory()

    def spent(seconds: float) -> float:
        file = Path(folder.name) / f"{seconds}.csd"
        file.write_text(orchestra(opcode, seconds))
        before = _children()
        report = command([program, "-n", "-d", "-m0", str(file)])
        after = _children()
        if peak(report) == 0.0:
            raise Missing(f"`{kind}` of Csound is silent")
        return after - before

    spent(SHORT)  # a program may be here and still not work
    return Voices(opcode.voices, LONG - SHORT, partial(spent, LONG), partial(spent, SHORT))


def orchestra(opcode: Opcode, seconds: float) -> str:
    """An orchestra and a score: all voices sound for some seconds, summed."""
    length = 0.5 if opcode.is_struck else seconds
    starts = [length * i for i in range(int(seconds / length))]
    notes = "\n".join(f"i1 {t:g} {length:g}" for t in starts for _ in range(opcode.voices))
    return f"""<CsoundSynthesizer>
<CsInstruments>
sr = {RATE}
ksmps = {BLOCK}
nchnls = 1
0dbfs = 1
gasum init 0
instr 1
  {opcode.lines}
  gasum += a1
endin
instr 2
  out gasum
  clear gasum
endin
</CsInstruments>
<CsScore>
{notes}
i2 0 {seconds:g}
</CsScore>
</CsoundSynthesizer>
"""


def peak(report: str) -> float:
    """The loudest sample that Csound reports when it ends."""
    reported = re.search(r"overall amps:[^\d\n]*([\d.]+)", report)
    return float(reported.group(1)) if reported else 0.0


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def pm(name: str) -> Voices:
    """Voices of a model of pm.lib, as instances of one compiled program; raises Missing."""
    kind = _MODELS.index(name.removeprefix("pm."))
    play = faust.Program("voice", {"kind": kind}).voices(RATE, _FAUST_VOICES)
    n_frames = int(LONG - SHORT) * RATE // BLOCK * BLOCK
    if not 0.0 < play(n_frames) < float("inf"):
        raise Missing(f"`{name}` of Faust is silent or diverges")
    return Voices(_FAUST_VOICES, n_frames / RATE, counted(lambda: play(n_frames)))


PROGRAMS: dict[str, Callable[[str], Voices]] = {"Csound": csound, "Faust": pm}
