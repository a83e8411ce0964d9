"""Turns an instrument's outputs and the mix's routes into taps of the network and channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import repeat
from math import floor, sqrt

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Instrument, Output, Target
from ergon.notation.clock.positions import Position
from ergon.notation.text.errors import Collector
from ergon.scores.reading.mixing import Fade, PanPath, Room
from ergon.scores.reading.outputs import Route
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.tones import Tone
from ergon.scores.staging.loudspeakers import Loudspeakers

_INSTANT_MAX = 1e9  # [s]
_ROUTE_NS, _ROOM_NS = 10.0, 300.0
_REFERENCE_PRESSURE = 1.0  # pressure of a radiating route at the reference level [Pa]
_WeightedRange = tuple[int, int, float]
FrameCurve = tuple[tuple[int, float, bool], ...]  # (frame, ratio, whether the way is smooth)


@dataclass(frozen=True, slots=True)
class TapRoute:
    """A way from a tap of the network to a channel (from 0).

    Its gain is `ratio`, which all ways of a route have, by `share`. `reference_amount` is what the
    tap gives at the reference level, in SI units.
    """

    part: str
    tap: int
    channel: int
    ratio: float
    reference_amount: float
    is_squared: bool
    highpass: float | None
    share: float = 1.0
    room: int | None = None  # in place of the channel
    delay: int = 0  # frames
    fade: FrameCurve | None = None
    tones: tuple[Tone, ...] = ()
    echo: tuple[int, float] | None = None  # frames and ratio of what goes into the delay again
    # Places between two channels, and whether this is the way to the second.
    pan: tuple[FrameCurve, bool] | None = None

    def gain(self, reference: float | None, unit: float) -> float:
        """The gain, in units of `unit`, of samples in SI units or, with a reference, of those at
        which the reference level has this ratio of full scale.
        """
        gain = self.ratio / unit * self.share
        return gain if reference is None else gain * (reference / self.reference_amount)


@dataclass(slots=True)
class Listening:
    """Taps and the ways from them to the loudspeakers."""

    n_channels: int
    outputs: list[str] = field(default_factory=list)
    tap_routes: list[TapRoute] = field(default_factory=list)
    rooms: tuple[Room, ...] = ()
    fade: FrameCurve = ()  # of all channels
    # Instruments whose taps give silence, because their sound is known from elsewhere (frozen
    # parts).
    silent_instruments: Container[str] = ()

    def taps(self, part: str) -> list[int]:
        """The taps of an instrument, rising."""
        return sorted({tap_route.tap for tap_route in self.tap_routes if tap_route.part == part})

    def parts(self) -> list[str]:
        """Instruments that reach a loudspeaker, in order."""
        return list(dict.fromkeys(tap_route.part for tap_route in self.tap_routes))

    def largest_ratio(self, parts: Collection[str]) -> float:
        """The largest ratio of the ways of some parts: what they give in units of it stays what it
        is where the gain of a route, or of all, is another.
        """
        return (
            max(
                (abs(tap_route.ratio) for tap_route in self.tap_routes if tap_route.part in parts),
                default=0.0,
            )
            or 1.0
        )

    def mixer(
        self,
        rate: float,
        n_out: int,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        parts: Collection[str] | None = None,
        is_wet: bool | None = None,
        unit: float = 1.0,
    ) -> _core.Mixer:
        """A new mixer of all ways, or of those of some parts; `highpass` [Hz] is for ways without
        their own.

        `is_wet`: True for the ways into rooms alone, False for all others. Gains are in units of
        `unit`.
        `reference` is the ratio of full scale at which reference quantities are heard; None
        leaves SI units.
        """
        mixer = _core.Mixer(rate, n_out, self.n_channels)
        for room in self.rooms:
            channels = [channel - 1 for channel in room.to] or range(self.n_channels)
            mixer.room(room.name, channels, size=room.size, t60=room.t60, gain=room.gain)
        if self.fade:
            mixer.fade(self.fade)
        # The routes of an instrument form a group, whose gain may change while it sounds.
        group_by_part = {name: group for group, name in enumerate(self.parts())}
        for tap_route in self.tap_routes:
            is_chosen = is_wet is None or is_wet == (tap_route.room is not None)
            if is_chosen and (parts is None or tap_route.part in parts):
                cutoff = highpass if tap_route.highpass is None else tap_route.highpass
                mixer.route(
                    tap_route.tap,
                    tap_route.channel if tap_route.room is None else tap_route.room,
                    tap_route.gain(reference, unit),
                    cutoff or None,
                    group_by_part[tap_route.part],
                    tones=[(tone.kind, tone.frequency, tone.level) for tone in tap_route.tones],
                    delay=tap_route.delay,
                    echo=tap_route.echo,
                    curve=tap_route.fade,
                    pan=tap_route.pan,
                    to_room=tap_route.room is not None,
                    squared=tap_route.is_squared,
                )
        return mixer

    def mix_key(
        self,
        tap_hashes: Sequence[str],
        *,
        highpass: float | None = None,
        reference: float | None = None,
        parts: Collection[str] | None = None,
        unit: float = 1.0,
        with_silent: bool = False,
    ) -> str:
        """A hash of all that the frames of such a mixer depend on, up to a frame up to which
        `tap_hashes` are the hashes of what each tap gives, empty where that is silence, which
        changes no mix. The state of a mixer has places for ways `with_silent` taps, too.
        """
        rooms = [(room.size, room.t60, room.to, room.gain) for room in self.rooms]
        route_keys = [
            (
                tap_hashes[tap_route.tap],
                tap_route.channel,
                tap_route.gain(reference, unit),
                highpass if tap_route.highpass is None else tap_route.highpass,
                tap_route.room,
                tap_route.delay,
                tap_route.fade,
                tap_route.tones,
                tap_route.echo,
                tap_route.pan,
                *(("squared",) if tap_route.is_squared else ()),
            )
            for tap_route in self.tap_routes
            if (tap_hashes[tap_route.tap] or with_silent)
            and (parts is None or tap_route.part in parts)
        ]
        return sha256(repr((self.n_channels, rooms, self.fade, route_keys)).encode()).hexdigest()

    @property
    def cost(self) -> float:
        """About how long mixing a frame takes [ns]."""
        return _ROUTE_NS * len(self.tap_routes) + _ROOM_NS * len(self.rooms)


def check_mix(piece: Piece, collector: Collector) -> None:
    """Report E202 if the decay of a room or a filter of a route cannot be realised."""
    mixer = _core.Mixer(piece.rate, 1, 1)
    for room in piece.mix.rooms:
        try:
            mixer.room(room.name, [0], size=room.size, t60=room.t60)
        except _core.EngineError as error:
            collector.error("E202", f"room {room.name}: {error}", room.place)
    for route in piece.mix.routes:
        tones = [(tone.kind, tone.frequency, tone.level) for tone in route.tones]
        try:
            mixer.route(0, 0, highpass=route.highpass or None, tones=tones)
        except _core.EngineError as error:
            collector.error("E202", f"route from {route.part}: {error}", route.place)


def audible_outputs(piece: Piece) -> list[tuple[Route, Instrument, Output]]:
    """The outputs that reach loudspeakers, each with its route and its instrument."""
    return [
        (route, *instrument_and_output)
        for route in piece.routes()
        for instrument_and_output in _outputs_of(piece, route)
    ]


def make_listening(piece: Piece, assembly: Assembly, silent: Container[str] = ()) -> Listening:
    """Add the taps that the piece's routes need to the network. Raises EngineError.

    Taps of `silent` instruments exist, but give silence.
    """
    routed_outputs = audible_outputs(piece)
    master = piece.mix.master
    listening = Listening(
        max(1, piece.mix.channels),
        rooms=piece.mix.rooms,
        fade=_fade_frames(piece, master.fade) if master else (),
        silent_instruments=silent,
    )
    taps: dict[tuple[str, str], list[int]] = {}
    n_outputs_by_route = Counter(route for route, *_ in routed_outputs)
    index_by_route: dict[Route, int] = {}
    for route, instrument, output in routed_outputs:
        output_index = index_by_route[route] = index_by_route.get(route, -1) + 1
        if output.nearest is not None or route.to == "nearest":
            _add_nearest_taps(listening, piece, assembly, instrument, output, route)
        else:
            output_key = instrument.name, output.name
            if output_key not in taps:
                taps[output_key] = _add_taps(listening, assembly, output_key, output)
            # With as many outputs as channels, each output has one channel, in order; else each
            # goes to all channels.
            has_channel_each = n_outputs_by_route[route] == len(route.to) and not route.is_panned
            channels = route.to[output_index : output_index + 1] if has_channel_each else route.to
            for tap in taps[output_key]:
                _add_tap_routes(
                    listening,
                    piece,
                    tap,
                    [channel_index - 1 for channel_index in channels],
                    route,
                    output,
                )
    used_channels = [tap_route.channel + 1 for tap_route in listening.tap_routes]
    used_channels += [channel for room in listening.rooms for channel in room.to]
    listening.n_channels = max(listening.n_channels, *used_channels, 1)
    return listening


def _outputs_of(piece: Piece, route: Route) -> Iterator[tuple[Instrument, Output]]:
    instrument = piece.instruments[route.part]
    for routed_output in instrument.outputs:
        if route.out is None or routed_output.name == route.out:
            yield instrument, routed_output


def _add_tap_routes(
    listening: Listening,
    piece: Piece,
    tap: int,
    channels: Iterable[int],
    route: Route,
    output: Output,
) -> None:
    ratio = route.ratio * (piece.mix.master.gain if piece.mix.master else 1.0)
    delay, reference_amount = 0, output.kind_facts.reference_amount
    if route.radiation is not None:
        reference_amount = _REFERENCE_PRESSURE
        ratio *= route.radiation.gain
        delay = route.radiation.delay(piece.rate)
    fade = _fade_frames(piece, route.fade) or None
    tap_route = TapRoute(
        *(route.part, tap, 0, ratio, reference_amount, output.kind_facts.is_energy, route.highpass),
        delay=delay,
        fade=fade,
        tones=route.tones,
    )
    if route.echo is not None:
        echo_frames, feedback = route.echo.frames(piece.rate), route.echo.feedback
        tap_route = replace(
            tap_route,
            delay=delay + echo_frames,
            echo=(echo_frames, feedback) if feedback and echo_frames else None,
        )
    pan_curve = _pan_frames(piece, route.pan_path)
    for channel_index, (channel, share) in enumerate(
        zip(channels, route.pan or repeat(1.0), strict=False)
    ):
        pan = (pan_curve, channel_index == 1) if pan_curve else None
        listening.tap_routes.append(replace(tap_route, channel=channel, share=share, pan=pan))
    rooms = [room.name for room in piece.mix.rooms]
    for name, share in route.sends:
        room_index = rooms.index(name)
        listening.tap_routes.append(replace(tap_route, room=room_index, share=share))


def fade_curves(piece: Piece) -> list[FrameCurve]:
    """The fades of a piece in frames: that of the master, then those of the routes, then how these
    move between their channels.
    """
    master = piece.mix.master
    return [
        _fade_frames(piece, master.fade if master else ()),
        *(_fade_frames(piece, route.fade) for route in piece.mix.routes if route.fade),
        *(_pan_frames(piece, route.pan_path) for route in piece.mix.routes if route.pan_path),
    ]


def _fade_frames(piece: Piece, fade: Fade) -> FrameCurve:
    """A fade with its instants in frames of the piece."""
    return tuple((_frame_at(piece, point.at), point.gain, point.is_smooth) for point in fade)


def _pan_frames(piece: Piece, path: PanPath) -> FrameCurve:
    """A pan with its instants in frames of the piece."""
    return tuple((_frame_at(piece, point.at), point.pan, point.is_smooth) for point in path)


def _frame_at(piece: Piece, written_position: Position) -> int:
    """The frame of the piece at a position."""
    tempo = piece.tempo_map
    instant = tempo.seconds(tempo.resolve(written_position))
    return floor(max(-_INSTANT_MAX, min(instant, _INSTANT_MAX)) * piece.rate + 0.5)


def _add_taps(
    listening: Listening, assembly: Assembly, output_name: tuple[str, str], output: Output
) -> list[int]:
    """Add taps for an output: the sum of its targets, or √(m/2)·v of each mass, whose square is its
    energy.
    """
    if not output.kind_facts.is_energy:
        return [_add_tap(listening, assembly, output_name, output)]
    elements = assembly.network.elements(list({target.part for target in output.targets}))
    masses = dict(zip(elements.mats, elements.masses, strict=True))
    taps: list[int] = []
    for mat in (mat for target in output.targets for mat in assembly.members(target)):
        listening.outputs.append(".".join(filter(None, (*output_name, str(len(taps) + 1)))))
        weighted_range = (mat, 1, sqrt(masses.get(mat, 0.0) / 2.0))
        positions = [] if output_name[0] in listening.silent_instruments else [weighted_range]
        tap_name, order = listening.outputs[-1], output.kind_facts.order
        taps.append(assembly.network.listen(tap_name, positions=positions, order=order))
    return taps


def _add_tap(
    listening: Listening, assembly: Assembly, output_name: tuple[str, str], output: Output
) -> int:
    """Add a tap for an output: the sum of its targets."""
    positions: list[_WeightedRange] = []
    forces: list[_WeightedRange] = []
    ground_ranges: list[_WeightedRange] = []
    lengths: list[_WeightedRange] = []
    is_silent = output_name[0] in listening.silent_instruments
    if output.is_distance and not is_silent:
        lengths.append((_add_length_link(assembly, output_name, output.targets), 1, 1.0))
    for target in output.targets if not (is_silent or output.is_distance) else ():
        if output.is_movement:
            positions.append(_mat_range(assembly, target))
        elif (target.part, target.module) in assembly.links:
            module_key = target.part, target.module
            for links in assembly.walls.get(module_key, [assembly.links[module_key]]):
                forces.append((links.start + int(target.first), target.count, 1.0))
        elif (target.part, target.module) in assembly.points:  # a net: all its springs
            springs = assembly.generator_links[target.part, target.module]
            forces.append((springs.start, len(springs), 1.0))
        else:
            ground_ranges.append(_mat_range(assembly, target))
    listening.outputs.append(".".join(filter(None, output_name)))
    return assembly.network.listen(
        listening.outputs[-1],
        positions=positions,
        forces=forces,
        ground_forces=ground_ranges,
        lengths=lengths,
        order=output.kind_facts.order,
    )


def _add_length_link(
    assembly: Assembly, name: tuple[str, str], end_targets: Sequence[Target]
) -> int:
    """Add a link without a force, whose length is the distance that is heard; returns its index."""
    part, listener_name = name
    assembly.network.part(part)
    first_mats, second_mats = (assembly.coordinates(end) for end in end_targets)
    return assembly.network.gauge(
        " ".join(filter(None, (listener_name, "distance"))), first_mats, second_mats
    )


def _mat_range(assembly: Assembly, target: Target) -> _WeightedRange:
    members = assembly.members(target)
    return members.start, len(members), 1.0


def _add_nearest_taps(
    listening: Listening,
    piece: Piece,
    assembly: Assembly,
    instrument: Instrument,
    output: Output,
    route: Route,
) -> None:
    """Route each member to the loudspeaker nearest to it: one tap for each loudspeaker."""
    layout = output.nearest or piece.mix.layout
    assert layout is not None
    loudspeakers = Loudspeakers(layout, instrument.placing)
    ranges_by_speaker: dict[int, list[_WeightedRange]] = {}
    for target in targets_of(instrument, output):
        for mat in assembly.members(target):
            ranges = ranges_by_speaker.setdefault(
                loudspeakers.nearest(assembly.network.position_of(mat)), []
            )
            if ranges and ranges[-1][0] + ranges[-1][1] == mat:
                ranges[-1] = ranges[-1][0], ranges[-1][1] + 1, 1.0
            else:
                ranges.append((mat, 1, 1.0))
    for loudspeaker in sorted(ranges_by_speaker):
        channel_index = layout.channels[loudspeaker]
        output_name = ".".join(filter(None, (instrument.name, output.name, str(channel_index + 1))))
        ranges = (
            ranges_by_speaker[loudspeaker]
            if instrument.name not in listening.silent_instruments
            else []
        )
        tap_arguments = {"ground_forces": ranges} if output.nearest else {"positions": ranges}
        listening.outputs.append(output_name)
        tap = assembly.network.listen(output_name, **tap_arguments, order=output.kind_facts.order)
        _add_tap_routes(listening, piece, tap, (channel_index,), route, output)


def targets_of(instrument: Instrument, routed_output: Output) -> Sequence[Target]:
    """The targets of an output."""
    return routed_output.targets or _bank_members(instrument)


def _bank_members(instrument: Instrument) -> list[Target]:
    """All members of an instrument's banks, which `SOF: {nearest: …}` listens to."""
    return [
        Target(instrument.name, module.name, 0, module.fields["count"], "", module.place)
        for module in instrument.modules
        if module.kind == "BANK"
    ]
