"""How a verb is written: its places in order, and the command that is made of their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ergon.repl.language import amounts, values
from ergon.repl.language.commands import Command, Word
from ergon.repl.language.values import Value


@dataclass(frozen=True, slots=True)
class Slot:
    """One place of a form: the field for its value, its name in the help, and its keyword.

    A `keyword` that ends in "=" is one word with its value (`K=40N/m`); a keyword without a value
    is a word of its own (`off`). `takes_many` takes all words up to the next keyword.
    """

    field: str
    placeholder: str
    value: Value | None = None
    keyword: str = ""
    optional: bool = False
    takes_many: bool = False

    @property
    def usage(self) -> str:
        """As help writes it: `[over LENGTH]`."""
        separator = "" if self.keyword[-1:] == "=" or not self.placeholder else " "
        text = f"{self.keyword}{separator}{self.placeholder}".strip()
        return f"[{text}]" if self.optional else text


@dataclass(frozen=True, slots=True)
class Form:
    """One way to write a verb. With `begins_with_subject`, its first slot comes before the verb."""

    verb: str
    short: str
    effect: str
    example: str
    make_command: Callable[..., Command]
    slots: tuple[Slot, ...] = ()
    takes_time: bool = True  # whether a line may end in `now`, `at C` or `in 2`
    begins_with_subject: bool = False
    needs_quotes: bool = False  # the argument is in quotes

    @property
    def usage(self) -> str:
        """As help writes it: `rest PLAYER|all`."""
        words = [slot.usage for slot in self.slots]
        words.insert(1 if self.begins_with_subject else 0, self.verb)
        return " ".join(words)


Words = Mapping[str, Word]


def form(
    verb: str,
    short: str,
    effect: str,
    example: str,
    make_command: Callable[..., Command],
    *slots: Slot,
    takes_time: bool = True,
    begins_with_subject: bool = False,
    needs_quotes: bool = False,
) -> Form:
    """A form: its verb, the shortest beginning by which that is understood, its effect, an example,
    what makes its command, its places.

    A short form is fixed: a verb that is added later gets one that leaves these alone, so that
    habits stay true.
    """
    return Form(
        verb,
        short,
        effect,
        example,
        make_command,
        slots,
        takes_time,
        begins_with_subject,
        needs_quotes,
    )


# Places that several verbs have.
PLAYER_SLOT = Slot("player", "PLAYER", values.PLAYER_VALUE)
OVER_SLOT = Slot("over", "LENGTH", amounts.LENGTH_VALUE, "over", optional=True)
OFF_SLOT = Slot("", "", None, "off")
LINK_SLOTS = (
    Slot("stiffness", "STIFFNESS", amounts.STIFFNESS_VALUE, "K=", optional=True),
    Slot("viscosity", "VISCOSITY", amounts.DAMPING_VALUE, "Z=", optional=True),
)
SHOWN_SLOT = Slot("name", "NAME", amounts.NAME_OR_PARAMETER, optional=True)
