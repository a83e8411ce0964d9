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
class InitialMotion:
    """A point when the score begins: its position [m], its last step [m], and the jump that its
    dampers feel [m].
    """

    x: float
    step: float = 0.0
    jump: float = 0.0


def jump_force(
    link: Link,
    values: Mapping[str, float],
    first_motion: InitialMotion,
    second_motion: InitialMotion,
) -> float:
    """The force of the jump on the first end of a link, which the score lacks; the second end has
    its opposite.

    `values` are those of the statement.
    """
    elongation = (
        second_motion.x
        - first_motion.x
        - (0.0 if "thresh" in link.fields else values.get("thresh", 0.0))
    )
    elongation_step, jump = (
        second_motion.step - first_motion.step,
        second_motion.jump - first_motion.jump,
    )
    if link.kind == "LNL":
        constants = {letter: values.get(name, 0.0) for letter, name in link.fields.items()}
        law = _core.Law(link.law or None, link.damping or None, constants)
        return law.force(elongation, elongation_step + jump) - law.force(
            elongation, elongation_step
        )
    if link.kind == "BUT" and elongation >= 0.0:
        return 0.0
    return values.get("Z", 0.0) * jump
