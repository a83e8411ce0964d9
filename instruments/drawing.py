"""Speed and force of a bow that acts lead: constants of a link that follow masses.

An act that draws or presses strikes a mass in thick oil, which goes as far as the impulse says and
stays there: a millimetre for 0.1 N·s. A constant of the link follows the mass, from its written
value on. The opposite impulse brings it back.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

from ergon.instruments.following import Following
from ergon.instruments.model import Module
from ergon.notation.tables import quantities
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import MISSING, NAME, Name, Text, choice
from ergon.notation.tables.strengths import ImpulseRange
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

_METRES_PER_UNIT = 10e-3  # m, for each SI unit of the constant
_OIL_VISCOSITY = 100.0  # N·s/m; with _METRES_PER_UNIT an impulse of 1 N·s is one SI unit
# Masses [kg]; with _OIL_VISCOSITY they come to rest within 20 ms and 10 ms.
_MASS_BY_FIELD = {"draw": 2.0, "press": 1.0}


class LinkRange(NamedTuple):
    """A link, and what a constant of it is for the softest and for the hardest stroke."""

    link: str
    soft: float
    hard: float


@dataclass(frozen=True, slots=True)
class _BowField:
    """A field of acts that leads a constant of a link."""

    constant: str
    dimension: quantities.Dimension
    example: str
    doc: str

    def parse(self, text: str) -> LinkRange:
        """`hair 0.2N..2N`. Raises TextError."""
        link_name, _, range_text = text.strip().partition(" ")
        if not NAME.fullmatch(link_name) or not range_text.strip():
            message = f"a link and a range are expected, such as {self.example}"
            raise TextError(message, length=max(1, len(text)), code="E201")
        example = self.example.partition(" ")[2]
        try:
            soft_and_hard = quantities.span(
                range_text, lambda word: quantities.quantity(word, self.dimension), example
            )
        except TextError as error:
            error.offset += len(text) - len(text.lstrip()) + len(link_name) + 1
            raise
        if not 0.0 < soft_and_hard[0] < soft_and_hard[1]:
            message = "the softest and the hardest stroke are expected, both above 0, "
            raise TextError(f"{message}such as {example}", length=len(text), code="E202")
        return LinkRange(link_name, *soft_and_hard)


BOW_FIELDS = {
    "draw": _BowField(
        "u", quantities.SPEED, "hair 0.04m/s..0.4m/s", "how fast a link rubs: its `u`"
    ),
    "press": _BowField("F", quantities.PUSH, "hair 0.2N..2N", "how hard a link presses: its `F`"),
}
BOW_ACT_FIELDS = (
    *(
        Field(
            name,
            Text(
                lru_cache(256)(word.parse),
                f"a link and a range, such as {word.example}",
                types=("string",),
            ),
            word.doc,
            shown="nothing",
        )
        for name, word in BOW_FIELDS.items()
    ),
    Field("until", choice("note"), "when drawing and pressing end", "note"),
)


class StruckMass(NamedTuple):
    """What an act that draws or presses strikes: the name of a mass, and its impulses."""

    mass: str
    impulses: ImpulseRange


class DrawnActs:
    """The acts of an instrument that draw or press, by their written values."""

    def __init__(self, written_acts: Mapping[str, Any]) -> None:
        """Take the acts by name; reports links that no act brings."""
        self._acts = {name: body for name, body in written_acts.items() if body is not MISSING}
        self._act_of_link: dict[str, str] = {}  # the act that brings each link
        for name, act_body in self._acts.items():
            for link in act_body["with"] or ():
                self._act_of_link.setdefault(link, name)
        self._hardest_values: dict[tuple[str, str], float] = defaultdict(float)
        self._alternating: set[tuple[str, str]] = set()
        for act_body in self._acts.values():
            for constant_word, led_mass in _link_ranges(act_body):
                if self._is_known(act_body, constant_word, led_mass):
                    self._hardest_values[led_mass.link, constant_word] += led_mass.hard
                    if constant_word == "draw" and act_body["turns"]:
                        self._alternating.add((led_mass.link, constant_word))

    def struck_masses(self, body: Values) -> list[StruckMass]:
        """What an act strikes to draw and to press."""
        return [
            StruckMass(
                _mass_name(led_mass.link, word),
                ImpulseRange(
                    led_mass.soft, led_mass.hard, (led_mass.link, word) in self._alternating
                ),
            )
            for word, led_mass in _link_ranges(body)
            if (led_mass.link, word) in self._hardest_values
        ]

    def modules(
        self, body: Values, modules_of: Callable[[Mapping[str, Any]], tuple[Module, ...]]
    ) -> tuple[Module, ...]:
        """The modules that an act brings, with the masses that lead constants of its links."""
        written_modules: dict[str, Any] = dict(body["with"] or {})
        for _, led_mass in _link_ranges(body):
            if led_mass.link in self._act_of_link:
                written_modules = {
                    **(self._acts[self._act_of_link[led_mass.link]]["with"] or {}),
                    **written_modules,
                }
        brought_modules = []
        for part_module in modules_of(written_modules):
            words = [
                word for word in BOW_FIELDS if (part_module.name, word) in self._hardest_values
            ]
            brought_modules += [
                part for word in words for part in _leading_mass_modules(part_module, word)
            ]
            brought_modules.append(
                self._with_followed_masses(part_module, words) if words else part_module
            )
        return tuple(brought_modules)

    def _is_known(self, body: Values, word: str, led: LinkRange) -> bool:
        """Whether a link is one that an act brings, and has no such constant; reports others."""
        act_label, constant = body.context.label(word), BOW_FIELDS[word].constant
        act_fields = (
            None if led.link not in self._act_of_link else self._acts[self._act_of_link[led.link]]
        )
        if act_fields is None:
            message = f"{act_label}: no act brings a link {quote(led.link)}; write it in `with`"
            suggestion = nearest(led.link, self._act_of_link)
            body.error("E301", message, word, suggestion=suggestion)
            return False
        link_values = act_fields["with"][led.link]
        link_fields = (
            link_values.by_name.get(link_values.kind, MISSING)
            if link_values is not MISSING
            else MISSING
        )
        if link_fields is MISSING:
            return False  # reported already
        if link_values.kind != "LNL":
            message = (
                f"{act_label}: {quote(led.link)} is a {link_values.kind}; only an LNL has "
                f"{constant}"
            )
            body.error("E304", message, word)
            return False
        if constant in (link_fields["follows"] or ()):
            message = (
                f"{act_label}: {constant} of {quote(led.link)} follows a MAT; keep one of the two"
            )
            body.error("E111", message, word)
            return False
        return True

    def _with_followed_masses(self, link_module: Module, constant_words: Sequence[str]) -> Module:
        """A link whose constants follow the masses that lead them, from their written values on."""
        follows, field_places = dict(link_module.fields["follows"] or {}), dict(link_module.places)
        constants = dict(link_module.fields["constants"])
        for constant_word in constant_words:
            constant, high_value = (
                BOW_FIELDS[constant_word].constant,
                self._hardest_values[link_module.name, constant_word],
            )
            low_value = (
                -high_value if (link_module.name, constant_word) in self._alternating else 0.0
            )
            rest_value = constants.pop(constant, 0.0)
            leading_mass = Name(_mass_name(link_module.name, constant_word), link_module.place)
            span = _METRES_PER_UNIT * (high_value - low_value)
            follows[constant] = Following(
                leading_mass,
                rest_value + low_value,
                rest_value + high_value,
                -_METRES_PER_UNIT * low_value,
                span,
            )
            field_places.setdefault("follows", link_module.place)
        fields = {**link_module.fields, "follows": follows, "constants": constants}
        return replace(link_module, fields=fields, places=field_places)


def _link_ranges(body: Values) -> Iterator[tuple[str, LinkRange]]:
    for word in BOW_FIELDS:
        if body[word] is not None:
            yield word, body[word]


def _mass_name(link: str, word: str) -> str:
    return f"{link}-{word}"


def _leading_mass_modules(link: Module, constant_word: str) -> Iterator[Module]:
    """A mass that a constant follows, in its oil."""
    mass_name, link_place = _mass_name(link.name, constant_word), link.place
    rest_fields = {"X0": 0.0, "V0": 0.0, "follows": ()}
    yield Module(mass_name, "MAS", {"M": _MASS_BY_FIELD[constant_word], **rest_fields}, link_place)
    yield Module(f"{mass_name}-ground", "SOL", {"X0": 0.0}, link_place)
    link_ends = Name(f"{mass_name}-ground", link_place), Name(mass_name, link_place)
    yield Module(f"{mass_name}-oil", "FRO", {"between": link_ends, "Z": _OIL_VISCOSITY}, link_place)
