"""How a verb is written: its places in order, and the command that is made of their values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ergon.notation.clock.positions import Length
from ergon.notation.text.errors import TextError
from ergon.repl.language import commands as c
from ergon.repl.language.values import Value


@dataclass(frozen=True, slots=True)
class Slot:
    """One place of a form: the field for its value, its name in the help, and its lead word.

    A `lead` that ends in "=" is one word with its value (`K=40N/m`); a lead without a value is a
    word of its own (`off`). `many` takes all words up to the next lead.
    """

    field: str
    placeholder: str
    value: Value | None = None
    lead: str = ""
    optional: bool = False
    many: bool = False

    @property
    def written(self) -> str:
        """As help writes it: `[over LENGTH]`."""
        joint = "" if self.lead[-1:] == "=" or not self.placeholder else " "
        text = f"{self.lead}{joint}{self.placeholder}".strip()
        return f"[{text}]" if self.optional else text


@dataclass(frozen=True, slots=True)
class Form:
    """One way to write a verb. With `subject`, its first slot comes before the verb."""

    verb: str
    short: str
    effect: str
    example: str
    make: Callable[..., c.Command]
    slots: tuple[Slot, ...] = ()
    timed: bool = True  # may end in `now`, `at C` or `in 2`
    subject: bool = False
    quoted: bool = False  # what follows the verb is in quotes

    @property
    def written(self) -> str:
        """As help writes it: `rest PLAYER|all`."""
        words = [slot.written for slot in self.slots]
        words.insert(1 if self.subject else 0, self.verb)
        return " ".join(words)


Words = Mapping[str, c.Word]


def set_parameter(
    target: str,
    change: tuple[float | None, float | None],
    over: Length | None,
    *,
    when: c.When,
    words: Words,
) -> c.Set:
    """Set a value, or multiply by a factor."""
    return c.Set(target, *change, over, when=when, words=words)


def couple(
    a: str,
    b: str,
    stiffness: float | None,
    viscosity: float | None,
    *,
    when: c.When,
    words: Words,
) -> c.Couple:
    """Couple two keys by a REF with K, Z or both. Raises TextError."""
    if stiffness is None and viscosity is None:
        end = words["b"].end
        raise TextError("a coupling needs K, Z or both: couple k1 k2 K=40N/m", offset=end)
    return c.Couple(a, b, stiffness or 0.0, viscosity or 0.0, when=when, words=words)


def record_audio(file: str | None = None, *, when: c.When, words: Words) -> c.RecordAudio:
    """Record sound into a file; without a file, end the recording."""
    return c.RecordAudio(file, when=when, words=words)


def tempo(
    bpm: tuple[float, float | None], over: Length | None, *, when: c.When, words: Words
) -> c.Tempo:
    """Set a tempo, or a ramp, which needs both tempos and a length. Raises TextError."""
    if (bpm[1] is None) != (over is None):
        word = words["over" if bpm[1] is None else "bpm"]
        message = "a ramp needs two tempos and a length: tempo 60 -> 84 over 4bar"
        raise TextError(message, offset=word.start, length=len(word.text))
    return c.Tempo(*bpm, over, when=when, words=words)


def build(
    name: str,
    base: tuple[str, float, Mapping[str, str]],
    *,
    when: c.When,
    words: Words,
) -> c.Build:
    """Build an instrument with its own fields."""
    return c.Build(name, *base, when=when, words=words)


def scene(
    names: tuple[str, str | None], over: Length | None, *, when: c.When, words: Words
) -> c.Scene:
    """Play a scene, or go from one scene to another, which needs a length. Raises TextError."""
    first, second = names
    if second is None:
        return c.Scene(first, None, over, when=when, words=words)
    if over is None:
        word = words["names"]
        message = "the way from one scene to another needs a length: scene A -> B over 4bar"
        raise TextError(message, offset=word.start, length=len(word.text))
    return c.Scene(second, first, over, when=when, words=words)
