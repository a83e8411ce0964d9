"""Verbs of instruments and keys: parameters, links, names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ergon.notation.clock.positions import Length
from ergon.notation.text.errors import TextError
from ergon.repl.language import amounts, structure, values
from ergon.repl.language.commands import BlockCommand, Command, When
from ergon.repl.language.forms import LINK_SLOTS, OVER_SLOT, Slot, Words, form


@dataclass(frozen=True, slots=True)
class Set(BlockCommand):
    """Set a physical parameter to a value [SI], or multiply it by a factor, gliding for the length
    `over`.
    """

    target: str
    value: float | None
    factor: float | None
    over: Length | None


@dataclass(frozen=True, slots=True)
class Couple(BlockCommand):
    """Join two keys by a REF: `stiffness` [N/m], `viscosity` [Ns/m]."""

    a: str
    b: str
    stiffness: float
    viscosity: float


@dataclass(frozen=True, slots=True)
class Uncouple(BlockCommand):
    """Remove the couplings between two keys."""

    a: str
    b: str


@dataclass(frozen=True, slots=True)
class Build(BlockCommand):
    """`bell2 = bell/bell transpose 7st`: add an instrument made from another, or from one in a
    file.

    `fields` replace its fields, as written.
    """

    name: str
    base: str
    semitones: float
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Link(BlockCommand):
    """Join two modules by a link of a kind, with its fields as written."""

    a: str
    b: str
    kind: str
    fields: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Takes(BlockCommand):
    """Let a player take a key; a new key is a copy of the key `like` (None: of the first)."""

    player: str
    key: str
    like: str | None = None


@dataclass(frozen=True, slots=True)
class Remove(BlockCommand):
    """Remove what a name refers to, and what belongs to it alone."""

    name: str


@dataclass(frozen=True, slots=True)
class Rename(Command):
    """Give a gesture, a phrase, a take, a player, a block, a key or an instrument another name."""

    old: str
    name: str


def set_parameter(
    target: str,
    change: tuple[float | None, float | None],
    over: Length | None,
    *,
    when: When,
    words: Words,
) -> Set:
    """Set a value, or multiply by a factor."""
    return Set(target, *change, over, when=when, words=words)


def couple(
    a: str,
    b: str,
    stiffness: float | None,
    viscosity: float | None,
    *,
    when: When,
    words: Words,
) -> Couple:
    """Couple two keys by a REF with K, Z or both. Raises TextError."""
    if stiffness is None and viscosity is None:
        line_end = words["b"].end
        raise TextError("a coupling needs K, Z or both: couple k1 k2 K=40N/m", offset=line_end)
    return Couple(a, b, stiffness or 0.0, viscosity or 0.0, when=when, words=words)


def build(
    name: str,
    base: tuple[str, float, Mapping[str, str]],
    *,
    when: When,
    words: Words,
) -> Build:
    """Build an instrument with its own fields."""
    return Build(name, *base, when=when, words=words)


# fmt: off
_KEY_SLOTS = Slot("a", "KEY", values.KEY_VALUE), Slot("b", "KEY", values.OTHER_KEY)
SET_FORM = form("set", "set", "a physical parameter glides to a value, or by a factor",
    "set bell.m.K x1.5 over 2bar", set_parameter,
    Slot("target", "PATH", amounts.TARGET_VALUE), Slot("change", "VALUE|xFACTOR",
    amounts.CHANGE_VALUE),
    OVER_SLOT)
COUPLE_FORM = form("couple", "c", "joins two keys by a spring and a damper",
    "couple k1 k2 K=40N/m", couple, *_KEY_SLOTS, *LINK_SLOTS)
BUILD_FORM = form("=", "=", "adds an instrument like another, or from a file",
    "bell2 = bell/bell transpose 7st", build,
    Slot("name", "NAME", structure.PART_NAME_VALUE),
    Slot("base", "INSTRUMENT|FILE/NAME [transpose Nst] [FIELD=VALUE …]", structure.BASE_VALUE,
    takes_many=True), begins_with_subject=True)
LINK_FORM = form("link", "li", "joins two modules, or a key and a module, by a link",
    "link k1 bell.m BUT K=4kN/m", Link,
    Slot("a", "MODULE", structure.LINK_END_VALUE), Slot("b", "MODULE", structure.OTHER_END_VALUE),
    Slot("kind", "KIND", structure.LINK_KIND_VALUE),
    Slot("fields", "FIELD=VALUE …", structure.LINK_FIELDS_VALUE, takes_many=True))
TAKES_FORM = form("takes", "t", "the player takes a key; who and what is new is added",
    "mia takes k3 like k1", Takes,
    Slot("player", "NAME", structure.PLAYER_NAME_VALUE),
    Slot("key", "KEY", structure.KEY_NAME_VALUE),
    Slot("like", "KEY", values.KEY_VALUE, "like", optional=True), begins_with_subject=True)
REMOVE_FORM = form("remove", "rem", "removes what has a name, and what belongs to it alone",
    "remove bell", Remove, Slot("name", "NAME", structure.REMOVABLE_VALUE))
RENAME_FORM = form("rename", "ren", "gives what has a name another name",
    "rename lean tilt", Rename,
    Slot("old", "NAME", structure.RENAMED_VALUE), Slot("name", "NAME", values.NEW_NAME))
UNCOUPLE_FORM = form("uncouple", "unc", "removes what joins two keys",
    "uncouple k1 k2", Uncouple, *_KEY_SLOTS)
# fmt: on
