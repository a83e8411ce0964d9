"""A bank of modes as a Csound orchestra: a resonator for each mode, fed by strikes."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.workshop.models.programs.bank import UNITS, Bank
from ergon.workshop.models.programs.derivative import weights

BANK_MAX = 20_000  # resonators
# Numbers of instruments, which Csound plays in their order in each sample: strikes, modes, output.
_MODES_FROM, _OUTPUT = 100, 9_999


def orchestra(bank: Bank) -> str:
    """The text of a `.csd` file, which Csound plays into a file of floats."""
    return "\n".join((*_orchestra(bank), *_score(bank), "</CsoundSynthesizer>")) + "\n"


def _numbers(bank: Bank) -> tuple[int, int]:
    """The number of the first instrument of modes, and that of the output."""
    modes_from = max(_MODES_FROM, len(bank.struck) + 1)
    return modes_from, max(_OUTPUT, modes_from + len(bank.ways))


def _orchestra(bank: Bank) -> Iterator[str]:
    modes_from, output = _numbers(bank)
    yield "<CsoundSynthesizer>"
    yield f"; {_plain(bank.name)}, made by ergon: its modes, each a resonator."
    yield f"; It can be played at any rate of samples: change sr, here {bank.rate:g} Hz."
    yield "<CsOptions>"
    yield "-d -f -W  ; floats into a WAV file: -o FILE; -odac plays it"
    yield "</CsOptions>"
    yield "<CsInstruments>"
    yield f"sr = {bank.rate:g}"
    yield "ksmps = 1  ; a strike is one sample"
    yield f"nchnls = {len(bank.outputs)}"
    yield "0dbfs = 1"
    yield ""
    for number, name in enumerate(bank.struck, 1):
        yield f"gaPush{number} init 0  ; [N s] on {_plain(name)} in this sample"
    outputs_with_scales = zip(bank.outputs, bank.full, strict=True)
    for number, ((name, order), full) in enumerate(outputs_with_scales, 1):
        yield f"gaOut{number} init 0  ; [m] {_plain(name)}"
        yield f"giFull{number} = {full!r}  ; [{UNITS[order]}] of it is full scale"
    yield ""
    for number, name in enumerate(bank.struck, 1):
        yield f"instr {number}  ; a strike on {_plain(name)}"
        yield "  aStrike mpulse p4, 0  ; p4 [N s] impulse"
        yield f"  gaPush{number} += aStrike"
        yield "endin"
        yield ""
    for number, path in enumerate(bank.ways, modes_from):
        struck, output_index = bank.struck[path.struck], bank.outputs[path.output][0]
        yield f"instr {number}  ; a mode, from {_plain(struck)} to {_plain(output_index)}"
        yield "  iFrequency = p4  ; [Hz] damped"
        yield "  iDecay = p5      ; [1/s]; T60 = 6.9078/p5 s"
        yield "  iAmplitude = p6  ; [m/(N s)]"
        yield "  iPhase = p7      ; [rad]"
        yield "  iRadius = exp(-iDecay/sr)"
        yield "  iAngle = 2*$M_PI*iFrequency/sr"
        yield "  ; an impulse gives iAmplitude*exp(-iDecay*t)*sin(2*pi*iFrequency*t + iPhase)"
        yield f"  aMode biquad gaPush{path.struck + 1}, iAmplitude*sin(iPhase), \\"
        yield "      iAmplitude*iRadius*sin(iAngle - iPhase), 0, \\"
        yield "      1, -2*iRadius*cos(iAngle), iRadius*iRadius"
        yield f"  gaOut{path.output + 1} += aMode"
        yield "endin"
        yield ""
    yield f"instr {output}  ; what is heard"
    for number, (_, order) in enumerate(bank.outputs, 1):
        yield from _differentiated(number, order)
    outs = (f"aHeard{number}/giFull{number}" for number in range(1, len(bank.outputs) + 1))
    yield f"  out {', '.join(outs)}"
    names = [f"gaPush{number}" for number in range(1, len(bank.struck) + 1)]
    names += [f"gaOut{number}" for number in range(1, len(bank.outputs) + 1)]
    yield from (f"  {name} = 0" for name in names)
    yield "endin"
    yield "</CsInstruments>"


def _differentiated(number: int, order: int) -> Iterator[str]:
    """A position, or its speed or acceleration as the engine computes them, some samples late."""
    if order == 0:
        yield f"  aHeard{number} = gaOut{number}"
        return
    shares = weights(order)
    side = len(shares)
    yield f"  ; differentiated over {2 * side - 2 + order} samples"
    yield f"  aWas{number}_0 = gaOut{number}"
    last_delay = 2 * side - 2 + order
    for delay in range(1, last_delay + 1):
        yield f"  aWas{number}_{delay} delay1 aWas{number}_{delay - 1}"
    yield f"  aHeard{number} = 0"
    for delay, share in enumerate(shares):
        samples_before, samples_after = (
            f"aWas{number}_{n_samples}"
            for n_samples in (side + delay + order - 1, side - 1 - delay)
        )
        pair = (
            f"{samples_after} - {samples_before}"
            if order == 1
            else f"{samples_after} + {samples_before} - 2*aWas{number}_{side}"
        )
        scale = "sr" if order == 1 else "sr*sr"
        yield f"  aHeard{number} += {share!r}*{scale}*({pair})"


def _score(bank: Bank) -> Iterator[str]:
    length = repr(bank.seconds)
    modes_from, output = _numbers(bank)
    yield "<CsScore>"
    yield f"i {output} 0 {length}"
    for number, path in enumerate(bank.ways, modes_from):
        struck, output_index = bank.struck[path.struck], bank.outputs[path.output][0]
        yield f"; modes, from {_plain(struck)} to {_plain(output_index)}"
        yield "; instr begins lasts frequency[Hz] decay[1/s] amplitude phase[rad]"
        for row in path.rows:
            yield f"i {number} 0 {length} {' '.join(map(repr, row))}"
    for number, (name, strikes) in enumerate(zip(bank.struck, bank.strikes, strict=True), 1):
        yield f"; strikes on {_plain(name)}"
        yield "; instr at lasts impulse[N s]"
        for instant, impulse in strikes:
            begins = round(instant * bank.rate) / bank.rate
            yield f"i {number} {begins!r} {1.0 / bank.rate!r} {impulse!r}"
    yield "e"
    yield "</CsScore>"


def _plain(text: str) -> str:
    """A text that cannot end a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", " ").replace("<", " ")
