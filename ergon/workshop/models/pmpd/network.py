"""Masses and links of a pmpd object, and its inlets and outlets."""

from __future__ import annotations

from dataclasses import dataclass, field

from ergon.workshop.models.pmpd.words import Object

PORTS_MAX = 99  # inlets, outlets


@dataclass(slots=True)
class Mass:
    """A mass of a class at x [m] with a last step v [m] and a pending force f."""

    class_name: str
    is_mobile: bool
    M: float
    x: float
    line: int
    v: float = 0.0
    f: float = 0.0
    air_damping: float = 0.0  # against its own speed


@dataclass(slots=True)
class Link:
    """A link of masses by their indices; `last_length` is its length [m] when it was last read.

    `form` is the kind of law: "link~" and "NLlink~" of pmpd~, "link" and "table" of pmpd.
    """

    class_name: str
    form: str
    a: int
    b: int
    K: float
    D: float
    Pow: float
    L: float
    Lmin: float
    Lmax: float
    last_length: float
    line: int
    tables: tuple[str, float, str, float] | None = None


@dataclass(frozen=True, slots=True)
class Port:
    """An inlet or outlet of a mass: `word` is its kind, `gain` its factor."""

    word: str
    number: int
    mass: int
    gain: float
    line: int


@dataclass(frozen=True, slots=True)
class Request:
    """Masses of which pmpd is asked for positions or speeds."""

    word: str
    masses: tuple[int, ...]
    line: int


@dataclass(slots=True)
class Network:
    """The object that messages have made."""

    kind: Object
    masses: list[Mass] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    nl_links: list[Link] = field(default_factory=list)
    ports: list[Port] = field(default_factory=list)
    requests: list[Request] = field(default_factory=list)
    arrays: dict[str, list[float]] = field(default_factory=dict)
    n_ports: tuple[int, int] = (PORTS_MAX, PORTS_MAX)  # inlets, outlets
    has_run: bool = False
