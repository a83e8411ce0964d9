"""A bank of modes as a Faust program: a resonator for each mode, at any rate of samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ergon.workshop.models.programs.bank import UNITS, Bank
from ergon.workshop.models.programs.derivative import differentiated
from ergon.workshop.models.programs.faust_program import plain

MOST = 2_000  # resonators: Faust 2.54 takes 14 s for them, 80 s for twice as many


def program(bank: Bank) -> str:
    """The text of a program: an audio input [N] for each struck point, an audio output for each
    output.
    """
    return "\n".join(_lines(bank)) + "\n"


def _lines(bank: Bank) -> Iterator[str]:
    yield f"// {plain(bank.name)}, made by ergon: its modes, each a resonator."
    yield "// It holds at any rate of samples. Compile it with -double."
    for number, name in enumerate(bank.struck, 1):
        yield f"// input {number}: force on {plain(name)} [N]"
    for number, (name, order) in enumerate(bank.heard, 1):
        yield f"// output {number}: {plain(name)} [{UNITS[order]}]"
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
    for number, way in enumerate(bank.ways, 1):
        struck, heard = bank.struck[way.struck], bank.heard[way.heard][0]
        yield ""
        yield f"// from {plain(struck)} to {plain(heard)}"
        terms = [f"mode({', '.join(map(_number, row))}, x)" for row in way.rows]
        yield f"way_{number}(x) = {_sum(terms)};"
    yield ""
    inputs = [f"in_{number}" for number in range(1, len(bank.struck) + 1)]
    outputs = [f"out_{number}" for number in range(1, len(bank.heard) + 1)]
    heard_as = zip(outputs, bank.heard, strict=True)
    said = [_heard(name, order) for name, (_, order) in heard_as]
    yield f"process({', '.join(inputs)}) = {', '.join(said)}"
    yield "with {"
    for at, name in enumerate(outputs):
        ways = [
            f"way_{number}({inputs[way.struck]}/SR)"
            for number, way in enumerate(bank.ways, 1)
            if way.heard == at
        ]
        yield f"  {name} = {' + '.join(ways) or '0.0'};"
    yield "};"


def _sum(terms: Sequence[str]) -> str:
    """A sum as a balanced tree: Faust takes six times as long for a thousand terms summed from left
    to right.
    """
    if len(terms) == 1:
        return terms[0]
    half = len(terms) // 2
    return f"({_sum(terms[:half])}\n  + {_sum(terms[half:])})"


def _heard(name: str, order: int) -> str:
    return "*".join([f"({differentiated(name, order, 1.0)})", *["SR"] * order])


def _number(value: float) -> str:
    return f"({value!r})" if value < 0 else repr(value)
