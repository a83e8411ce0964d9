"""The history: numbers of versions in the order of effect; `Schedule.past_versions` has them.

`undo`, `redo`, `back` and `history` use these numbers; `session_commands` defines what they do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ergon.repl.session.version import PastVersion


@dataclass(slots=True)
class History:
    """Numbers of versions, waiting ones included; `index` is the place of the last that was not
    undone.

    Versions after `index` were undone after they had taken effect. `removed_numbers` are those of
    them after which another line was typed.
    """

    numbers: list[int] = field(default_factory=lambda: [0])
    index: int = 0
    removed_numbers: set[int] = field(default_factory=set)

    @property
    def undone_numbers(self) -> set[int]:
        """The numbers of versions that were undone."""
        return self.removed_numbers.union(self.numbers[self.index + 1 :])

    @property
    def current_number(self) -> int:
        """The number of the last version that was not undone."""
        return self.numbers[self.index]

    def add(self, number: int) -> None:
        """Add a version; versions that were undone are removed."""
        self.removed_numbers = self.undone_numbers
        del self.numbers[self.index + 1 :]
        self.numbers.append(number)
        self.index += 1

    def remove(self, number: int) -> None:
        """Remove a version that will not take effect."""
        if number in self.numbers:
            number_index = self.numbers.index(number)
            del self.numbers[number_index]
            self.index -= number_index <= self.index

    def go_to(self, number: int) -> None:
        """Note that an earlier version is restored; an unknown number changes nothing."""
        if number in self.numbers:
            self.index = self.numbers.index(number)

    def sort(self, effect_order: Mapping[int, float]) -> None:
        """Sort the versions that were not undone into the order in which they take effect.

        Versions that are not in `effect_order` come first: they have taken effect long before.
        """
        stop_index = self.index + 1
        first_index = max(0, stop_index - len(effect_order) - 1)  # those before it are in order
        numbers = self.numbers[first_index:stop_index]
        unmoved_numbers = [number for number in numbers if number not in effect_order]
        moved_numbers = sorted(
            [moved_number for moved_number in numbers if moved_number in effect_order],
            key=effect_order.__getitem__,
        )
        self.numbers[first_index:stop_index] = unmoved_numbers + moved_numbers


@dataclass(frozen=True, slots=True)
class PastVersions:
    """The history of a resumed session: its versions, and the place of the present one."""

    versions: Sequence[PastVersion]
    index: int
