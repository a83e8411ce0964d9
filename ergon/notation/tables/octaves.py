"""How far apart two frequencies are."""

from __future__ import annotations

import math

from ergon import _core

_LN_2 = 0.6931471805599453


def octaves_of_ratio(ratio: float) -> float:
    """The octaves of a ratio of frequencies above 0, equal to the last bit on any machine.

    `math.log2` is of the machine's C library, whose last bit may differ with its processor.
    """
    mantissa, exponent = math.frexp(ratio)
    return exponent + _core.ln(mantissa) / _LN_2
