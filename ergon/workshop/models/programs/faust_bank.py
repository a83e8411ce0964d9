"""A bank of modes as a Faust program: a resonator for each mode, at any rate of samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ergon.workshop.models.programs.bank import UNITS, Bank
from ergon.workshop.models.programs.derivative import differentiated
from ergon.workshop.models.programs.faust_program import plain

BANK_MAX = 2_000  # resonators: Faust 2.54 takes 14 s for them, 80 s for twice as many


def program(bank: Bank) -> str:
    """The text of a program: an audio input [N] for each struck point, an audio output for each
    output.
    """
    return "\n".join(_lines(bank)) + "\n"


def _lines(bank: Bank) -> Iterator[str]:
    yield f"// {plain(bank.name)}, made by ergon: its modes, each a resonator."
    yield "// It holds at any rate of samples. Compile it with -double."
    for input_number, input_name in enumerate(bank.struck_names, 1):
        yield f"// input {input_number}: force on {plain(input_name)} [N]"
    for output_number, (output_name, order) in enumerate(bank.outputs, 1):
        yield f"// output {output_number}: {plain(output_name)} [{UNITS[order]}]"
    yield f'declare name "{plain(bank.name)}";'
    yield ""
    yield "SR = float(fconstant(int fSamplingFreq, <math.h>)); // [Hz]"
    yield "turn(f) = 6.283185307179586*f/SR; // [rad] in a sample"
    yield "// f [Hz], damped; d [1/s], T60 = 6.9078/d s; a [m/Ns] and p [rad]:"
    yield "// an impulse of 1 Ns gives a*exp(-d*t)*sin(2*PI*f*t + p)"
    yield "mode(f, d, a, p, x) = a*sin(p)*x + a*r*sin(turn(f) - p)*x' : + ~ back"
    yield "with {"
    yield "  r = exp(0.0 - d/SR);"
    yield "  back(y) = 2.0*r*cos(turn(f))*y - r*r*y';"
    yield "};"
    for path_number, path in enumerate(bank.paths, 1):
        struck_name, output_name = (
            bank.struck_names[path.struck_index],
            bank.outputs[path.output_index][0],
        )
        yield ""
        yield f"// from {plain(struck_name)} to {plain(output_name)}"
        terms = [f"mode({', '.join(map(_number, mode_values))}, x)" for mode_values in path.modes]
        yield f"way_{path_number}(x) = {_balanced_sum(terms)};"
    yield ""
    input_names = [f"in_{number}" for number in range(1, len(bank.struck_names) + 1)]
    output_names = [f"out_{number}" for number in range(1, len(bank.outputs) + 1)]
    output_orders = zip(output_names, bank.outputs, strict=True)
    expressions = [_output_text(name, order) for name, (_, order) in output_orders]
    yield f"process({', '.join(input_names)}) = {', '.join(expressions)}"
    yield "with {"
    for index, output_name in enumerate(output_names):
        terms_of_output = [
            f"way_{number}({input_names[path.struck_index]}/SR)"
            for number, path in enumerate(bank.paths, 1)
            if path.output_index == index
        ]
        yield f"  {output_name} = {' + '.join(terms_of_output) or '0.0'};"
    yield "};"


def _balanced_sum(terms: Sequence[str]) -> str:
    """A sum as a balanced tree: Faust takes six times as long for a thousand terms summed from left
    to right.
    """
    if len(terms) == 1:
        return terms[0]
    half = len(terms) // 2
    return f"({_balanced_sum(terms[:half])}\n  + {_balanced_sum(terms[half:])})"


def _output_text(name: str, order: int) -> str:
    return "*".join([f"({differentiated(name, order, 1.0)})", *["SR"] * order])


def _number(number: float) -> str:
    return f"({number!r})" if number < 0 else repr(number)
