"""Force by which the jump of an input in the first step of a model acts through its links.

Before the first sample an input stands at its x0, then at the first value of its file. A model's
dampers feel that jump. A score's input begins where its file begins, so the force of the jump
becomes a strike there, one sample long.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ergon import _core
from ergon.workshop.models.mims.laws import Link


@dataclass(frozen=True, slots=True)
class Begin:
    """A point when the score begins: its position [m], its last step [m], and the jump that its
    dampers feel [m].
    """

    x: float
    step: float = 0.0
    jump: float = 0.0


def kick(
    link: Link, model_values: Mapping[str, float], first_begin: Begin, second_begin: Begin
) -> float:
    """The force of the jump on the first end of a link, which the score lacks; the second end has
    its opposite.

    `model_values` are those of the statement.
    """
    elongation = (
        second_begin.x
        - first_begin.x
        - (0.0 if "thresh" in link.fields else model_values.get("thresh", 0.0))
    )
    step_difference, jump = (
        second_begin.step - first_begin.step,
        second_begin.jump - first_begin.jump,
    )
    if link.kind == "LNL":
        constants = {letter: model_values.get(name, 0.0) for letter, name in link.fields.items()}
        compiled_law = _core.Law(link.law or None, link.damping or None, constants)
        return compiled_law.force(elongation, step_difference + jump) - compiled_law.force(
            elongation, step_difference
        )
    if link.kind == "BUT" and elongation >= 0.0:
        return 0.0
    return model_values.get("Z", 0.0) * jump
