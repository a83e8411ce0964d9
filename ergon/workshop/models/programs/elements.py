"""Parts of a score for other programs, and the stepped points and links that are made of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ergon import _core
from ergon.instruments.model import Module, Output
from ergon.notation.text.values import Place

NOWHERE = Place("", 0, 0)


@dataclass(frozen=True, slots=True)
class Part:
    """An instrument or a key: its modules, its outputs, and the rate of its algorithmic values.

    `struck_module` is the module of a key that a hand moves.
    """

    name: str
    modules: Sequence[Module]
    outputs: Sequence[Output] = ()
    ca_rate: float | None = None
    struck_module: str | None = None


@dataclass(slots=True)
class Point:
    """A mass. Its step [m] for a force f is y = (1 - zeta)·d - kappa·(x - rest) + gain·f.

    It starts at `x0` [m] after a step `d0` [m]. `mass` is 0 for a fixed point, and `position_input`
    is the input that gives its position. `comment` describes it by the words of the score.
    """

    name: str
    x0: float
    comment: str
    mass: float = 0.0
    gain: float = 0.0
    kappa: float = 0.0
    zeta: float = 0.0
    rest: float = 0.0
    v0: float = 0.0
    d0: float = 0.0
    is_ca: bool = False
    position_input: int | None = None
    force_inputs: list[int] = field(default_factory=list)  # inputs that push it
    weight: float = 0.0  # [N] a force that never changes
    shares: tuple[tuple[int, float], ...] = ()  # points of a PROXY with its share in each
    place: Place = NOWHERE


@dataclass(frozen=True, slots=True)
class Link:
    """A link between the points `a` and `b`: K in N/m, `z` the force for a step of one metre.

    A contact has an `exponent`, and the `side` (1 or -1) from which the first point comes. An
    LNL has its `law`, and K and z are 0.
    """

    name: str
    a: int
    b: int
    K: float
    z: float
    offset: float
    comment: str
    exponent: float | None = None
    side: int = 1
    is_clamped: bool = False
    law: Law | None = None
    place: Place = NOWHERE


@dataclass(frozen=True, slots=True)
class Law:
    """The law of an LNL: the fields of the module, and the law of the core.

    `per_step` is the speed for a step of one metre: 1 under `units: ca`, else the rate [1/s].
    """

    fields: Mapping[str, Any]
    compiled: _core.Law
    per_step: float


@dataclass(frozen=True, slots=True)
class Body:
    """A generator of equal masses and equal links, `mass_counts` across and up, at rest at 0.

    Its points that move are the first of `points`, row by row.
    """

    name: str
    kind: str
    is_held: bool
    mass_counts: tuple[int, int]
    points: range
    links: range
    K: float
    z: float


@dataclass(frozen=True, slots=True)
class MixedOutput:
    """An output: the sum of positions of points, differentiated `order` times, or of forces of
    links.
    """

    name: str
    points: Sequence[int] = ()
    links: Sequence[int] = ()
    order: int = 0
    place: Place = NOWHERE


@dataclass(frozen=True, slots=True)
class Input:
    """An input: its description, and the take from which a score feeds it, if any."""

    name: str
    take: str = ""


@dataclass(slots=True)
class SteppedNetwork:
    """Points and links at a rate, with inputs and outputs."""

    rate: float
    points: list[Point] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    inputs: list[Input] = field(default_factory=list)
    outputs: list[MixedOutput] = field(default_factory=list)
    omissions: list[str] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)
