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
    modes_from, first_output = _numbers(bank)
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
    for input_number, input_name in enumerate(bank.struck, 1):
        yield f"gaPush{input_number} init 0  ; [N s] on {_plain(input_name)} in this sample"
    outputs_with_scales = zip(bank.outputs, bank.full, strict=True)
    for output_number, ((output_name, derivative_order), full) in enumerate(outputs_with_scales, 1):
        yield f"gaOut{output_number} init 0  ; [m] {_plain(output_name)}"
        yield f"giFull{output_number} = {full!r}  ; [{UNITS[derivative_order]}] of it is full scale"
    yield ""
    for input_number, input_name in enumerate(bank.struck, 1):
        yield f"instr {input_number}  ; a strike on {_plain(input_name)}"
        yield "  aStrike mpulse p4, 0  ; p4 [N s] impulse"
        yield f"  gaPush{input_number} += aStrike"
        yield "endin"
        yield ""
    for instrument_number, path in enumerate(bank.ways, modes_from):
        struck, output_name = bank.struck[path.struck], bank.outputs[path.output][0]
        yield f"instr {instrument_number}  ; a mode, from {_plain(struck)} to {_plain(output_name)}"
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
    yield f"instr {first_output}  ; what is heard"
    for output_number, (_, derivative_order) in enumerate(bank.outputs, 1):
        yield from _differentiated(output_number, derivative_order)
    outs = (f"aHeard{number}/giFull{number}" for number in range(1, len(bank.outputs) + 1))
    yield f"  out {', '.join(outs)}"
    names = [f"gaPush{number}" for number in range(1, len(bank.struck) + 1)]
    names += [f"gaOut{number}" for number in range(1, len(bank.outputs) + 1)]
    yield from (f"  {name} = 0" for name in names)
    yield "endin"
    yield "</CsInstruments>"


def _differentiated(output_number: int, derivative_order: int) -> Iterator[str]:
    """A position, or its speed or acceleration as the engine computes them, some samples late."""
    if derivative_order == 0:
        yield f"  aHeard{output_number} = gaOut{output_number}"
        return
    pair_weights = weights(derivative_order)
    half_width = len(pair_weights)
    yield f"  ; differentiated over {2 * half_width - 2 + derivative_order} samples"
    yield f"  aWas{output_number}_0 = gaOut{output_number}"
    last_delay = 2 * half_width - 2 + derivative_order
    for delay in range(1, last_delay + 1):
        yield f"  aWas{output_number}_{delay} delay1 aWas{output_number}_{delay - 1}"
    yield f"  aHeard{output_number} = 0"
    for delay, pair_weight in enumerate(pair_weights):
        samples_before, samples_after = (
            f"aWas{output_number}_{n_samples}"
            for n_samples in (half_width + delay + derivative_order - 1, half_width - 1 - delay)
        )
        pair = (
            f"{samples_after} - {samples_before}"
            if derivative_order == 1
            else f"{samples_after} + {samples_before} - 2*aWas{output_number}_{half_width}"
        )
        scale = "sr" if derivative_order == 1 else "sr*sr"
        yield f"  aHeard{output_number} += {pair_weight!r}*{scale}*({pair})"


def _score(bank: Bank) -> Iterator[str]:
    score_seconds = repr(bank.seconds)
    modes_from, output = _numbers(bank)
    yield "<CsScore>"
    yield f"i {output} 0 {score_seconds}"
    for instrument_number, path in enumerate(bank.ways, modes_from):
        struck, output_name = bank.struck[path.struck], bank.outputs[path.output][0]
        yield f"; modes, from {_plain(struck)} to {_plain(output_name)}"
        yield "; instr begins lasts frequency[Hz] decay[1/s] amplitude phase[rad]"
        for row in path.rows:
            yield f"i {instrument_number} 0 {score_seconds} {' '.join(map(repr, row))}"
    for instrument_number, (name, strikes) in enumerate(
        zip(bank.struck, bank.strikes, strict=True), 1
    ):
        yield f"; strikes on {_plain(name)}"
        yield "; instr at lasts impulse[N s]"
        for instant, impulse in strikes:
            begins = round(instant * bank.rate) / bank.rate
            yield f"i {instrument_number} {begins!r} {1.0 / bank.rate!r} {impulse!r}"
    yield "e"
    yield "</CsScore>"


def _plain(text: str) -> str:
    """A text that cannot end a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", " ").replace("<", " ")
