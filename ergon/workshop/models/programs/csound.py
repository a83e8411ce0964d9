"""A bank of modes as a Csound orchestra: a resonator for each mode, fed by strikes."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.workshop.models.programs.bank import UNITS, Bank
from ergon.workshop.models.programs.derivative import derivative_weights

BANK_MAX = 20_000  # resonators
# Numbers of instruments, which Csound plays in their order in each sample: strikes, modes, output.
_FIRST_MODE_NUMBER, _OUTPUT_NUMBER_MIN = 100, 9_999


def orchestra(bank: Bank) -> str:
    """The text of a `.csd` file, which Csound plays into a file of floats."""
    return "\n".join((*_orchestra(bank), *_score(bank), "</CsoundSynthesizer>")) + "\n"


def _instrument_numbers(bank: Bank) -> tuple[int, int]:
    """The number of the first instrument of modes, and that of the output."""
    first_mode_instrument = max(_FIRST_MODE_NUMBER, len(bank.struck_names) + 1)
    return first_mode_instrument, max(_OUTPUT_NUMBER_MIN, first_mode_instrument + len(bank.paths))


def _orchestra(bank: Bank) -> Iterator[str]:
    first_mode_instrument, output_instrument = _instrument_numbers(bank)
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
    for point_number, point_name in enumerate(bank.struck_names, 1):
        yield f"gaPush{point_number} init 0  ; [N s] on {_plain(point_name)} in this sample"
    scaled_outputs = zip(bank.outputs, bank.full_scales, strict=True)
    for output_number, ((output_name, derivative_order), full_scale) in enumerate(
        scaled_outputs, 1
    ):
        yield f"gaOut{output_number} init 0  ; [m] {_plain(output_name)}"
        unit = UNITS[derivative_order]
        yield f"giFull{output_number} = {full_scale!r}  ; [{unit}] of it is full scale"
    yield ""
    for point_number, point_name in enumerate(bank.struck_names, 1):
        yield f"instr {point_number}  ; a strike on {_plain(point_name)}"
        yield "  aStrike mpulse p4, 0  ; p4 [N s] impulse"
        yield f"  gaPush{point_number} += aStrike"
        yield "endin"
        yield ""
    for instrument_number, path in enumerate(bank.paths, first_mode_instrument):
        struck_name, output_name = (
            bank.struck_names[path.struck_index],
            bank.outputs[path.output_index][0],
        )
        mode_path = f"from {_plain(struck_name)} to {_plain(output_name)}"
        yield f"instr {instrument_number}  ; a mode, {mode_path}"
        yield "  iFrequency = p4  ; [Hz] damped"
        yield "  iDecay = p5      ; [1/s]; T60 = 6.9078/p5 s"
        yield "  iAmplitude = p6  ; [m/(N s)]"
        yield "  iPhase = p7      ; [rad]"
        yield "  iRadius = exp(-iDecay/sr)"
        yield "  iAngle = 2*$M_PI*iFrequency/sr"
        yield "  ; an impulse gives iAmplitude*exp(-iDecay*t)*sin(2*pi*iFrequency*t + iPhase)"
        yield f"  aMode biquad gaPush{path.struck_index + 1}, iAmplitude*sin(iPhase), \\"
        yield "      iAmplitude*iRadius*sin(iAngle - iPhase), 0, \\"
        yield "      1, -2*iRadius*cos(iAngle), iRadius*iRadius"
        yield f"  gaOut{path.output_index + 1} += aMode"
        yield "endin"
        yield ""
    yield f"instr {output_instrument}  ; what is heard"
    for output_number, (_, derivative_order) in enumerate(bank.outputs, 1):
        yield from _differentiated(output_number, derivative_order)
    scaled_signals = (
        f"aHeard{number}/giFull{number}" for number in range(1, len(bank.outputs) + 1)
    )
    yield f"  out {', '.join(scaled_signals)}"
    cleared_signals = [f"gaPush{number}" for number in range(1, len(bank.struck_names) + 1)]
    cleared_signals += [f"gaOut{number}" for number in range(1, len(bank.outputs) + 1)]
    yield from (f"  {signal} = 0" for signal in cleared_signals)
    yield "endin"
    yield "</CsInstruments>"


def _differentiated(output_number: int, derivative_order: int) -> Iterator[str]:
    """A position, or its speed or acceleration as the engine computes them, some samples late."""
    if derivative_order == 0:
        yield f"  aHeard{output_number} = gaOut{output_number}"
        return
    pair_weights = derivative_weights(derivative_order)
    half_width = len(pair_weights)
    yield f"  ; differentiated over {2 * half_width - 2 + derivative_order} samples"
    yield f"  aWas{output_number}_0 = gaOut{output_number}"
    delay_max = 2 * half_width - 2 + derivative_order
    for pair_index in range(1, delay_max + 1):
        yield f"  aWas{output_number}_{pair_index} delay1 aWas{output_number}_{pair_index - 1}"
    yield f"  aHeard{output_number} = 0"
    for pair_index, pair_weight in enumerate(pair_weights):
        earlier, later = (
            f"aWas{output_number}_{delay}"
            for delay in (
                half_width + pair_index + derivative_order - 1,
                half_width - 1 - pair_index,
            )
        )
        pair = (
            f"{later} - {earlier}"
            if derivative_order == 1
            else f"{later} + {earlier} - 2*aWas{output_number}_{half_width}"
        )
        rate_power = "sr" if derivative_order == 1 else "sr*sr"
        yield f"  aHeard{output_number} += {pair_weight!r}*{rate_power}*({pair})"


def _score(bank: Bank) -> Iterator[str]:
    duration = repr(bank.duration)
    first_mode_instrument, output_instrument = _instrument_numbers(bank)
    yield "<CsScore>"
    yield f"i {output_instrument} 0 {duration}"
    for instrument_number, path in enumerate(bank.paths, first_mode_instrument):
        struck_name, output_name = (
            bank.struck_names[path.struck_index],
            bank.outputs[path.output_index][0],
        )
        yield f"; modes, from {_plain(struck_name)} to {_plain(output_name)}"
        yield "; instr begins lasts frequency[Hz] decay[1/s] amplitude phase[rad]"
        for mode_values in path.modes:
            yield f"i {instrument_number} 0 {duration} {' '.join(map(repr, mode_values))}"
    for instrument_number, (point_name, point_strikes) in enumerate(
        zip(bank.struck_names, bank.strikes, strict=True), 1
    ):
        yield f"; strikes on {_plain(point_name)}"
        yield "; instr at lasts impulse[N s]"
        for instant, impulse in point_strikes:
            begin = round(instant * bank.rate) / bank.rate
            yield f"i {instrument_number} {begin!r} {1.0 / bank.rate!r} {impulse!r}"
    yield "e"
    yield "</CsScore>"


def _plain(text: str) -> str:
    """A text that cannot end a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", " ").replace("<", " ")
