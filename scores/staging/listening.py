"""From an instrument's outputs and the mix's routes to taps of the network and channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Instrument, Layout, Output, Target
from ergon.scores.reading.piece import Piece, Route

_Range = tuple[int, int, float]


@dataclass(frozen=True, slots=True)
class Way:
    """From a tap of the network to a channel (from 0); `gain` is a ratio."""

    part: str
    tap: int
    channel: int
    gain: float
    highpass: float | None


@dataclass(slots=True)
class Listening:
    """Taps and the ways from them to the loudspeakers."""

    n_channels: int
    outputs: list[str] = field(default_factory=list)
    ways: list[Way] = field(default_factory=list)
    # Instruments whose taps hear nothing: somebody else knows what they sound like.
    silent: Container[str] = ()

    def taps(self, part: str) -> list[int]:
        """Taps that an instrument is heard by, rising."""
        return sorted({way.tap for way in self.ways if way.part == part})

    def parts(self) -> list[str]:
        """Instruments that reach a loudspeaker, in order."""
        return list(dict.fromkeys(way.part for way in self.ways))

    def mixer(
        self, rate: float, n_out: int, *, highpass: float | None = None, part: str | None = None
    ) -> _core.Mixer:
        """A fresh mixer of all ways, or of one part's; `highpass` [Hz] where a way has none."""
        mixer = _core.Mixer(rate, n_out, self.n_channels)
        # The routes of an instrument are a group: its gain may be moved while it sounds.
        groups = {name: group for group, name in enumerate(self.parts())}
        for way in self.ways:
            if part is None or way.part == part:
                cut = highpass if way.highpass is None else way.highpass
                mixer.route(way.tap, way.channel, way.gain, cut or None, groups[way.part])
        return mixer


def heard(piece: Piece) -> list[tuple[Route, Instrument, Output]]:
    """What reaches loudspeakers, and by which route."""
    routes = piece.mix.routes or tuple(_unsaid(piece))
    return [(route, *one) for route in routes for one in _of(piece, route)]


def listen(piece: Piece, assembly: Assembly, silent: Container[str] = ()) -> Listening:
    """Add the taps that the piece's routes need to the network. Raises EngineError.

    The taps of `silent` instruments are there and hear nothing.
    """
    all_heard = heard(piece)
    listening = Listening(max(1, piece.mix.channels), silent=silent)
    taps: dict[tuple[str, str], int] = {}
    alone = Counter(route for route, *_ in all_heard)
    position: dict[Route, int] = {}
    for route, instrument, output in all_heard:
        index = position[route] = position.get(route, -1) + 1
        if output.nearest is not None or route.to == "nearest":
            _nearest(listening, piece, assembly, instrument, output, route)
        else:
            name = instrument.name, output.name
            if name not in taps:
                taps[name] = _tap(listening, assembly, name, output)
            # As many outputs as channels: one each, in order; else each output to all channels.
            channels = route.to[index : index + 1] if alone[route] == len(route.to) else route.to
            _ways(listening, piece, taps[name], (c - 1 for c in channels), route)
    used = (way.channel + 1 for way in listening.ways)
    listening.n_channels = max(listening.n_channels, *used, 1)
    return listening


def _unsaid(piece: Piece) -> Iterator[Route]:
    """Without routes every output has a channel of its own, in the order written."""
    channel = 0
    for instrument in piece.instruments.values():
        for output in instrument.outputs:
            channel += 1
            yield Route(instrument.name, output.name, (channel,), 1.0, None, output.place)


def _of(piece: Piece, route: Route) -> Iterator[tuple[Instrument, Output]]:
    instrument = piece.instruments[route.part]
    for output in instrument.outputs:
        if route.out is None or output.name == route.out:
            yield instrument, output


def _ways(
    listening: Listening, piece: Piece, tap: int, channels: Iterable[int], route: Route
) -> None:
    gain = route.gain * (piece.mix.master.gain if piece.mix.master else 1.0)
    for channel in channels:
        listening.ways.append(Way(route.part, tap, channel, gain, route.highpass))


def _tap(listening: Listening, assembly: Assembly, name: tuple[str, str], output: Output) -> int:
    """One output as one tap: the sum of what it listens to."""
    positions: list[_Range] = []
    forces: list[_Range] = []
    ground: list[_Range] = []
    for target in output.targets if name[0] not in listening.silent else ():
        if output.is_movement:
            positions.append(_range(assembly, target))
        elif (target.part, target.module) in assembly.links:
            forces.append((assembly.links[target.part, target.module], 1, 1.0))
        else:
            ground.append(_range(assembly, target))
    listening.outputs.append(".".join(filter(None, name)))
    return assembly.network.listen(
        listening.outputs[-1],
        positions=positions,
        forces=forces,
        ground_forces=ground,
        order=output.order,
    )


def _range(assembly: Assembly, target: Target) -> _Range:
    members = assembly.members(target)
    return members.start, len(members), 1.0


def _nearest(
    listening: Listening,
    piece: Piece,
    assembly: Assembly,
    instrument: Instrument,
    output: Output,
    route: Route,
) -> None:
    """Each member to the loudspeaker that lies nearest to it: one tap for each loudspeaker."""
    room = output.nearest or piece.mix.layout
    assert room is not None
    near: dict[int, list[_Range]] = {}
    for target in targets_of(instrument, output):
        for mat in assembly.members(target):
            ranges = near.setdefault(_speaker(assembly.network.position_of(mat), room), [])
            if ranges and ranges[-1][0] + ranges[-1][1] == mat:
                ranges[-1] = ranges[-1][0], ranges[-1][1] + 1, 1.0
            else:
                ranges.append((mat, 1, 1.0))
    for speaker in sorted(near):
        name = ".".join(filter(None, (instrument.name, output.name, str(speaker + 1))))
        ranges = near[speaker] if instrument.name not in listening.silent else []
        heard = {"ground_forces": ranges} if output.nearest else {"positions": ranges}
        listening.outputs.append(name)
        tap = assembly.network.listen(name, **heard, order=output.order)
        _ways(listening, piece, tap, (speaker,), route)


def targets_of(instrument: Instrument, output: Output) -> Sequence[Target]:
    """What an output listens to."""
    return output.targets or _everything(instrument)


def _everything(instrument: Instrument) -> list[Target]:
    """All members of an instrument's banks: what `SOF: {nearest: …}` listens to."""
    return [
        Target(instrument.name, module.name, 0, module.fields["count"], "", module.place)
        for module in instrument.modules
        if module.kind == "BANK"
    ]


def _speaker(place: tuple[float, float], room: Layout) -> int:
    x, y = place

    def distance(i: int) -> float:
        sx, sy, _ = room.speakers[i]
        return (sx - x) * (sx - x) + (sy - y) * (sy - y)

    return min(range(len(room.speakers)), key=distance)
