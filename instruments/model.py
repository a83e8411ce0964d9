"""The data of an instrument after reading: modules with SI fields, outputs, targets of names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from ergon.instruments.kinds.outputs import OUTPUTS, OutputKind
from ergon.instruments.space import Space
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import ImpulseRange
from ergon.notation.text.document import Node
from ergon.notation.text.values import Place

# The form in which an instrument is written: one axis in SI units or under `units: ca`, two or
# three axes.
Form = Literal["si", "ca", "space"]


@dataclass(frozen=True, slots=True)
class Target:
    """Modules that a name reaches: `bell.m`, `string.12`, `sky.all`, a key.

    `module` is "" if it has the name of its part. Members of a generator run from `first`,
    `count` of them; (0, 1) for a single module; `first` is "centre" for a generator's middle
    MAT. If whole points in space are named, `points` is the number of points of their module;
    for a coordinate, `first` counts axis by axis.
    """

    part: str
    module: str
    first: int | Literal["centre"]
    count: int
    text: str
    place: Place
    points: int = field(default=0, metadata={"hash_omits_empty": True})


@dataclass(frozen=True, slots=True)
class Layout:
    """Loudspeakers of a room: (x, y, z) [m]; x and y as on the bench of the modules.

    If `is_equidistant`, the bench is a plan with the zenith in the middle, and distances from it
    are angles; else the room is seen from above. A digest contains the file's content instead.
    `outputs` are those of the loudspeakers, from 1, where other outputs lie between them.
    """

    path: Path
    speakers: tuple[tuple[float, float, float], ...]
    is_equidistant: bool = False
    title: str = ""
    outputs: tuple[int, ...] = ()

    @property
    def channels(self) -> tuple[int, ...]:
        """The channel of each loudspeaker, from 0."""
        return tuple(output - 1 for output in self.outputs) or tuple(range(len(self.speakers)))

    @property
    def n_channels(self) -> int:
        """Number of channels up to the last one that has a loudspeaker."""
        return max(self.channels) + 1

    def channels_without_loudspeaker(self, n_channels: int) -> tuple[int, ...]:
        """Those of a number of channels, from 0, that have no loudspeaker."""
        return tuple(channel for channel in range(n_channels) if channel not in self.channels)


@dataclass(frozen=True, slots=True)
class Placing:
    """Where an instrument lies in a room: its size [m], its middle [m], and its height [m].

    A body of 1 m is `across` wide. Without a height it lies on the plan of the layout.
    """

    across: float
    at: tuple[float, float]
    height: float | None


class Places(Mapping[str, Place]):
    """Where fields are written; computed on demand, because most places are never needed."""

    def __init__(self, nodes: Mapping[str, Node]) -> None:
        """Take the nodes of the fields."""
        self._nodes = nodes

    def __getitem__(self, field: str) -> Place:
        """Where a field is written."""
        return self._nodes[field].place

    def __iter__(self) -> Iterator[str]:
        """The fields that are written."""
        return iter(self._nodes)

    def __len__(self) -> int:
        """How many fields are written."""
        return len(self._nodes)


@dataclass(frozen=True, slots=True)
class Module:
    """One module or generator: its kind and its fields in SI units.

    Links have `between`: (Target, Target); ENX and ENF have `to`: Target. The law of an LNL is
    in `law`, `damping`, `constants` or `points`. `written_kind` is set where a module was written
    as another kind, such as a MAGNET, which is an LNL.
    """

    name: str
    kind: str
    fields: Mapping[str, Any]
    place: Place
    places: Mapping[str, Place] = field(default_factory=dict, compare=False, repr=False)
    written_kind: str = field(
        default="", compare=False, repr=False, metadata={"hash_omits_empty": True}
    )

    @property
    def ends(self) -> tuple[Target, ...]:
        """What a link joins, once its names are looked up; empty for other kinds."""
        ends: tuple[Target, ...] = self.fields.get("between") or ()
        return ends

    @property
    def driven_mat(self) -> Target:
        """The MAT that an ENX or ENF drives, once its name is looked up."""
        target: Target = self.fields["to"]
        return target

    @property
    def shown_kind(self) -> str:
        """Its kind in messages and reports."""
        return self.written_kind or self.kind


@dataclass(frozen=True, slots=True)
class Output:
    """What is heard: the sum of a quantity, as its kind says.

    `name` is "" for a single output. With `nearest`, the force of every member goes to the
    loudspeaker nearest to it. If `is_distance`, the targets are two points in space, and their
    distance is heard.
    """

    name: str
    kind: str
    targets: tuple[Target, ...]
    nearest: Layout | None
    place: Place
    is_distance: bool = field(default=False, metadata={"hash_omits_empty": True})

    @property
    def kind_facts(self) -> OutputKind:
        """What its kind says of it."""
        return OUTPUTS[self.kind]

    @property
    def is_movement(self) -> bool:
        """Whether the movement of masses is heard, not a force, a distance or an energy."""
        return self.kind_facts.is_movement and not self.is_distance


@dataclass(frozen=True, slots=True)
class Hold:
    """What lasts as long as a note: `at` is struck where a note begins, by the impulse [N·s] that
    the strength of the note is in `reach`, and by the opposite where it ends.

    If it `is_lifted`, as a damper, the beginning is the opposite and the end the impulse.
    """

    at: tuple[Name, ...]
    reach: ImpulseRange
    targets: tuple[Target, ...] = ()
    is_lifted: bool = False

    def impulse(self, strength: float) -> float:
        """The impulse [N·s] of the beginning of a note; that of its end is the opposite."""
        impulse = self.reach.impulse(strength)
        return -impulse if self.is_lifted else impulse


PRESS = "press"  # the act that the pressure on a MIDI key plays


@dataclass(frozen=True, slots=True)
class Act:
    """A way in which an instrument is played; `at` are names as they are written inside it.

    `reach` [N·s] is the impulse of its softest and of its hardest stroke. `modules` are there once
    a line plays it. `targets` is what is struck, once the names are looked up. `holds` last as long
    as a note; so does what is struck, if it `is_drawn`. `lasts` is how long a stroke is [s]; None:
    as long as the engine says.
    """

    name: str
    at: tuple[Name, ...]
    reach: ImpulseRange
    place: Place
    modules: tuple[Module, ...] = ()
    targets: tuple[Target, ...] = ()
    holds: tuple[Hold, ...] = ()
    is_drawn: bool = False
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Instrument:
    """A network; under `ca_rate` [Hz] its M, K, Z are those of the discrete network at that rate.

    Its springs act once in `every` frames. `pitch` [Hz] is the named pitch of several modules as
    a whole, if they have one.
    """

    name: str
    modules: tuple[Module, ...]
    outputs: tuple[Output, ...]
    ca_rate: float | None
    place: Place
    every: int = 1
    pitch: float | None = field(default=None, compare=False)
    placing: Placing | None = field(default=None, metadata={"hash_omits_empty": True})
    space: Space | None = field(default=None, metadata={"hash_omits_empty": True})
    # How it is played does not change its matter, nor what is computed of it.
    acts: tuple[Act, ...] = field(default=(), compare=False)
    # How loud one stroke at mf is at 0 dB [LUFS].
    loudness: float | None = field(default=None, compare=False)

    @property
    def form(self) -> Form:
        """The form of the tables in which its modules are written."""
        return "space" if self.space else "si" if self.ca_rate is None else "ca"

    @property
    def axes(self) -> int:
        """How many axes its masses move along."""
        return self.space.axes if self.space else 1
