"""Transformations of patterns in cycles: how each is written, and what it does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycle_arguments import Reader
from ergon.scores.pattern.cycles import Cycles
from ergon.scores.pattern.struck import Struck

HALF = 0.5  # default share of events for `sometimes` and `degrade`

Pattern = Cycles[Struck]


@dataclass(frozen=True, slots=True)
class CycleTransform:
    """A transformation, the values of its arguments, and the `inner_transforms` ones that it takes.

    `number` is that of its draws by chance; `offset` and `length` are its place in the text.
    """

    word: str
    form: Form
    number: int
    values: tuple[Any, ...]
    inner_transforms: tuple[CycleTransform, ...]
    offset: int
    length: int

    @property
    def value(self) -> Any:
        """The only argument, or a half where that may be left out."""
        return self.values[0] if self.values else HALF

    def change(self, part: Pattern) -> Pattern:
        """The pattern after the inner transformations."""
        return apply(part, self.inner_transforms)


@dataclass(frozen=True, slots=True)
class Form:
    """How a transformation is written, and what it does.

    `arguments` has a list for each number of arguments that may be written. One that
    `takes_change` is followed by transformations, one that `takes_rhythm` by a rhythm. `check`
    returns what is wrong with arguments together.
    """

    description: str
    example: str
    transform_pattern: Callable[[CycleTransform, Pattern], Pattern]
    arguments: tuple[tuple[Reader, ...], ...] = ((),)
    takes_change: bool = False
    takes_rhythm: bool = False
    check: Callable[..., str | None] = lambda *_: None


def apply(cycles: Pattern, transforms: Sequence[CycleTransform]) -> Pattern:
    """Transform a pattern, from left to right. Raises TextError where it becomes too large."""
    for transform in transforms:
        cycles = transform.form.transform_pattern(transform, cycles)
        excess = cycles.excess()
        if excess is not None:
            message = f"after this transformation {excess}; remove it, or make the rhythm simpler"
            raise TextError(message, offset=transform.offset, length=transform.length)
    return cycles
