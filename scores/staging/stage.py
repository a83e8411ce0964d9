"""A piece on its stage: the network, the timeline, and the simulation that plays them."""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from typing import TYPE_CHECKING, Literal, NamedTuple

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.instruments import native
from ergon.instruments.assemble import Assembly
from ergon.notation.clock.shifted import NEVER, Standing
from ergon.notation.text.errors import Collector, Diagnostic, quote
from ergon.notation.text.lasting import lasting
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Accuracy, Piece
from ergon.scores.staging.automating import automated, led_on
from ergon.scores.staging.built_network import OVER, BuiltNetwork, acting, build_network
from ergon.scores.staging.hands import ALL, Hands, Sources, StagedGesture, Window
from ergon.scores.staging.listening import Listening, check_rooms
from ergon.scores.staging.live import LiveHand, held, join, stand_ins
from ergon.scores.staging.overlap import check_overlaps
from ergon.scores.staging.parameter_values import Led, Points, Where
from ergon.scores.staging.planning import Pins, Store, Watched, make
from ergon.scores.staging.striking import ANY, Striking
from ergon.scores.staging.takes import Takes
from ergon.scores.staging.travel import check_travel
from ergon.scores.staging.version_glides import Glide

if TYPE_CHECKING:
    from ergon.scores.staging.live import Real

_WHEN_STIFF = "reduce K or the law, weaken the strikes, or raise the rate"
_BY_METHOD = (
    "reduce K or the law, weaken the strikes, raise the rate, or leave the method to the plan"
)
LONGEST_TAIL = 60.0  # [s] of a score whose tail is `auto`
_LOOKED_AT = 5.0  # [s] of that tail, where nothing is rendered
MAX_SECONDS = 24 * 3600.0  # a day: longer is a slip of the pen


class StageError(ErgonError):
    """The engine does not play the piece; `diagnostics` say why, each with its place."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        """Take what was found."""
        super().__init__("\n".join(found.message for found in diagnostics))
        self.diagnostics = list(diagnostics)


@dataclass(slots=True)
class Stage:
    """Everything that plays a piece. `diagnostics` are warnings and notes.

    `planned_for` is the accuracy that the plan was made for.
    """

    piece: Piece
    built: BuiltNetwork
    simulation: _core.Simulation
    n_frames: int
    gestures: list[StagedGesture]
    sources: Sources
    diagnostics: list[Diagnostic]
    plan: _core.Plan | None = None
    is_plan_kept: bool = False
    live: tuple[LiveHand, ...] = ()
    takes: Mapping[Hashable, _core.Take] = field(default_factory=dict)
    paths: Mapping[Where, Points] = field(default_factory=dict)  # of modules with automation
    planned_for: Accuracy | None = None
    # After this frame a render ends where the sound has faded; None: at `n_frames`.
    fades_from: int | None = None
    placed: Sequence[Placed] = ()  # heard beside what is computed
    timeline: _core.Timeline | None = None  # what happens

    @property
    def network(self) -> _core.Network:
        """What is."""
        return self.built.network

    @property
    def listening(self) -> Listening:
        """What is heard of it, and where."""
        return self.built.listening

    @property
    def rate(self) -> float:
        """Frames a second [Hz]."""
        return self.piece.rate

    @property
    def n_looked_at(self) -> int:
        """Frames to the end, or to 5 s after the last event where the sound says the end."""
        if self.fades_from is None:
            return self.n_frames
        return min(self.n_frames, self.fades_from + int(_LOOKED_AT * self.rate + 0.5))

    @property
    def n_channels(self) -> int:
        """Loudspeakers."""
        return self.listening.n_channels

    def mixer(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        parts: Collection[str] | None = None,
    ) -> _core.Mixer:
        """A fresh mixer, of all instruments or of some `parts`.

        `highpass` [Hz] is for routes that say nothing of their own; `reference` is the ratio of
        full scale at which reference quantities are heard, None where samples are in SI units.
        """
        mixer = self.listening.mixer(
            self.rate, self.simulation.n_out, highpass=highpass, reference=reference, parts=parts
        )
        for one in self.placed:
            mixer.freeze(*one)
        return mixer

    def stems(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> list[tuple[str, _core.Mixer]]:
        """A fresh mixer for every instrument that is heard, with all of its notes."""
        family = self.piece.note_families()
        heard: dict[str, list[str]] = {}
        for part in self.listening.parts():
            heard.setdefault(family.get(part, part), []).append(part)
        return [
            (name, self.mixer(highpass=highpass, reference=reference, parts=parts))
            for name, parts in heard.items()
        ]

    def fault(self, error: _core.DivergedError) -> Diagnostic:
        """A part that went non-finite while it ran, in the place where it is written."""
        return Diagnostic("E401", str(error), _place(self.piece, error.module), None, self._hint)

    @property
    def _hint(self) -> str:
        """What to do where a part is too stiff for its steps."""
        planned_for = self.planned_for
        is_chosen = planned_for is not None and planned_for.method is not None
        return _BY_METHOD if is_chosen else _WHEN_STIFF

    def gains(self) -> list[Diagnostic]:
        """Modules that made energy so far, each in the place where it is written (W404)."""
        return [
            Diagnostic("W404", gain.sentence, _place(self.piece, gain.name), None, self._hint)
            for gain in self.simulation.gains()
        ]


# MATs by part, module and member (-1: the middle one), and the engine's number of each.
StrikePoints = Sequence[tuple[str, str, int, int]]


class Placed(NamedTuple):
    """Outputs that were computed before, and the taps that they are added to.

    Their first frame is heard at frame `begins` of the engine.
    """

    frozen: _core.FrozenOutputs
    taps: tuple[int, ...]
    begins: int


class Span(NamedTuple):
    """A stretch of a session: what a piece says of it is played."""

    piece: Piece
    window: Window


@dataclass(frozen=True, slots=True)
class Going:
    """A stage that takes over while another sounds: at frame `start`, where it is `like` it.

    `spans` is what is played, by parts of this piece and of those before it; None: all of it.
    `glides` are parameters that are still on their way. `strike_points` are MATs that may be struck
    while it plays.
    """

    spans: Sequence[Span] | None = None
    like: Stage | None = None
    start: int = 0
    glides: Sequence[Glide] = ()
    strike_points: StrikePoints = ()


@dataclass(slots=True)
class Ready:
    """All of a piece but what computes it. `collector` holds warnings and notes."""

    built: BuiltNetwork
    timeline: _core.Timeline
    n_frames: int
    hands: Hands
    collector: Collector
    live: tuple[LiveHand, ...]
    paths: Mapping[Where, Points]
    fades_from: int | None

    @property
    def network(self) -> _core.Network:
        """What is."""
        return self.built.network


@lasting
def prepare(
    piece: Piece,
    real: Real | None = None,
    silent: Container[str] = (),
    spans: Sequence[Span] | None = None,
    like: Stage | None = None,
    start: int = 0,
) -> Ready:
    """What is and what will happen in a piece. Raises StageError with every mistake found.

    `real`: players whose hands are real, and where each was at every tick, if that is known;
    `silent`: instruments that are not listened to; `spans`: what is played by parts of this piece
    and of others before it, all of this one if nothing is said; `like`: a stage whose takes, and
    whose network where it is the same, are used again; `start`: the frame at which this takes over
    from it.
    """
    collector = Collector()
    real = stand_ins(piece) | dict(real or {})
    try:
        computed = held(piece, real)
        built = (like and like.built.of(computed, silent)) or build_network(computed, silent)
        assembly, couplings = built.assembly, built.couplings
        timeline = _core.Timeline(assembly.network, piece.rate)
        if piece.accuracy.is_unguarded:
            timeline.leave_unguarded()
        takes = Takes(piece, collector, like.takes if like else {})
        hands = Hands(piece, timeline, takes, collector)
        # What a session plays has no end that its parts could stand in until.
        rests = spans is not None
        live = tuple(join(piece, real, assembly, timeline, collector, rests=rests))
        played = [Span(piece, ALL)] if spans is None else spans
        sounds = _sounds(piece, timeline, takes)
        _drives(piece, assembly, hands, {name: index for name, (index, _) in sounds.items()})
        end = max(_play(piece, assembly, hands, couplings, real, played), _length(piece, live))
        end = max([end, *(seconds for _, seconds in sounds.values())])
        check_overlaps(piece, hands.gestures, collector)
        check_travel(piece, timeline, hands.gestures, collector)
        check_rooms(piece, collector)
        n_frames = _frames(piece, end, collector) if spans is None else 0
        paths = _automate(piece, spans, n_frames, collector)
        if like is not None:
            paths = led_on(like.paths, paths, piece, start / piece.rate)
        for where, points in paths.items():
            if led := Led.of(piece, where):
                try:
                    led.put(timeline, assembly, where, points)
                except _core.EngineError as error:
                    _refuse(piece, collector, error)
    except _core.EngineError as error:
        raise _refused(piece, collector, error) from error
    if collector.has_errors():
        raise StageError(collector.finish())
    fades_from = int(end * piece.rate + 0.5) if piece.render.tail == "auto" else None
    return Ready(built, timeline, n_frames, hands, collector, live, paths, fades_from)


@lasting
def stage(
    piece: Piece,
    *,
    seed: int | None = None,
    ledger: bool = False,
    record: bool = False,
    planned: bool = False,
    fine_contacts: bool = False,
    pins: Pins | None = None,
    store: Store | None = None,
    threads: int = 1,
    real: Real | None = None,
    silent: Container[str] = (),
    on_fault: Literal["stop", "mute"] = "stop",
    going: Going | None = None,
    correction: float = 1.0,
    is_draft: bool = False,
    is_seen: bool = False,
) -> Stage:
    """Build all that plays a piece: module by module, or `planned` within its accuracy.

    A draft is planned without trials, and cheaply instead.

    A ledger is kept of every module alone, a stream of ergons where none strikes inside a body.
    With `fine_contacts` and no plan contacts are computed several times a frame. `pins` are the
    choices of an earlier plan, `store` keeps plans, `real` the players whose hands are real, with
    what is known of them, `silent` the instruments that are not listened to. A part that leaves all
    bounds ends the run, or is muted alone. Work takes `correction` times as long as the table of
    costs says. Where all of it `is_seen`, what nobody hears is computed too. What is `going` is to
    take over from another stage. Raises StageError with every mistake that the engine finds.
    """
    if seed is not None:
        piece = replace(piece, seed=seed)
    going = going or Going()
    like = going.like
    ready = prepare(piece, real, silent, going.spans, like, going.start)
    native.speed_up(ready.network, ready.n_frames)
    if going.spans is not None:
        ready.timeline.open()
    _add_glides(piece, ready, going)
    _add_strike_points(piece, ready, going)
    plan, is_kept, planned_for = None, False, None
    try:
        if planned:
            other = like.plan if like is not None else None
            parts = ready.network, ready.timeline, piece.accuracy, pins, store, other
            is_foreseen = going.spans is None and not real
            watched = Watched()
            if is_seen:
                everything = (*piece.keys, *piece.instruments)
                watched = Watched(seen=everything, seen_every=piece.motion_every)
            made = make(
                *parts,
                is_foreseen=is_foreseen,
                correction=correction,
                is_draft=is_draft,
                watched=watched,
            )
            plan, is_kept, planned_for = made.plan, made.is_kept, made.accuracy
            for code, sentence in made.notes:
                ready.collector.error(code, f"accuracy: {sentence}", piece.place)
            _report_unused_rates(piece, plan, ready.collector)
            if is_seen and piece.motion_every > 1:
                _report_motion(piece, plan, ready.collector)
        elif fine_contacts:
            plan = _core.Plan.with_fine_contacts(ready.network, ready.timeline)
        simulation = _core.Simulation(
            ready.network,
            ready.timeline,
            plan=plan,
            start=going.start,
            ledger=ledger,
            record=record,
            on_fault=on_fault,
            threads=threads,
        )
    except _core.EngineError as error:
        raise _refused(piece, ready.collector, error) from error
    return Stage(
        piece,
        ready.built,
        simulation,
        ready.n_frames,
        ready.hands.gestures,
        ready.hands.sources,
        ready.collector.finish(),
        plan,
        is_kept,
        ready.live,
        ready.hands.takes.files,
        ready.paths,
        planned_for,
        ready.fades_from,
        timeline=ready.timeline,
    )


def _automate(
    piece: Piece, spans: Sequence[Span] | None, n_frames: int, collector: Collector
) -> dict[Where, Points]:
    """The points of modules with automation, as far as the piece or its last stretch goes."""
    tempo = piece.tempo_map
    if not piece.automation and not any(strikes.notes for strikes in piece.strikes):
        return {}
    if spans is None:
        return automated(piece, -math.inf, tempo.beats(n_frames / piece.rate), collector)
    if isinstance(tempo, Standing) or not spans:
        here = tempo.beats(0.0)
        return automated(piece, here, here, collector)
    window = spans[-1].window
    return automated(piece, window.since, window.until, collector)


def _add_glides(piece: Piece, ready: Ready, going: Going) -> None:
    try:
        for glide in going.glides:
            if glide.written in ready.paths:
                continue  # automation leads it
            glide.put(ready.timeline, ready.built.assembly)
    except _core.EngineError as error:
        raise _refused(piece, ready.collector, error) from error


def _add_strike_points(piece: Piece, ready: Ready, going: Going) -> None:
    """Name the MATs that may be struck while it plays."""
    assembly = ready.built.assembly
    try:
        for part, module, member, number in going.strike_points:
            first = assembly.mats.get((part, module))
            if first is not None:  # nobody hears what is left out
                mat = ready.network.centre(first) if member < 0 else first + member
                ready.timeline.strike_point(mat, number)
    except _core.EngineError as error:
        raise _refused(piece, ready.collector, error) from error


def _report_unused_rates(piece: Piece, plan: _core.Plan, collector: Collector) -> None:
    """Report parts that have a rate of their own and go at the audio rate all the same (N403)."""
    for name, why in dict.fromkeys(plan.stay()):
        part = piece.keys.get(name) or piece.instruments[name]
        message = f"{quote(name)} is computed at the audio rate, not at a rate of its own: {why}"
        collector.error("N403", message, part.place)


def _report_motion(piece: Piece, plan: _core.Plan, collector: Collector) -> None:
    """Report what is only seen and goes at the audio rate, or that nothing is only seen (N403)."""
    rows = plan.seen()
    for row in rows:
        if row.stays is not None:
            names = " + ".join(map(quote, row.parts))
            message = f"{names} is computed at the audio rate, not at that of motion: {row.stays}"
            collector.error("N403", message, piece.place)
    if not rows:
        message = "no part goes at the rate of motion: all that moves is heard, or felt by a hand"
        collector.error("N403", message, piece.place)


def _refuse(piece: Piece, collector: Collector, error: _core.EngineError) -> None:
    """Report each module that the engine refuses (E309)."""
    for one in getattr(error, "refusals", ()) or (error,):
        collector.error("E309", str(one.args[0]), _place(piece, getattr(one, "module", None)))


def _refused(piece: Piece, collector: Collector, error: _core.EngineError) -> StageError:
    _refuse(piece, collector, error)
    return StageError(collector.finish())


def _length(piece: Piece, live: Sequence[LiveHand]) -> float:
    """When the last of what real hands are to do ends [s]."""
    return max((hand.tick_frames * hand.ticks / piece.rate for hand in live), default=0.0)


def _play(
    piece: Piece,
    assembly: Assembly,
    hands: Hands,
    couplings: Sequence[int],
    real: Real,
    spans: Sequence[Span],
) -> float:
    """Put everything virtual that happens on the timeline; returns when the last of it ends [s]."""
    timeline = hands.timeline
    live_keys = {piece.players[name].key for name in real}
    for name, key in piece.keys.items():
        if name not in live_keys:
            hands.key(name, assembly.mats[name, key.struck])
    for played, window in spans:
        span_hands = hands if window is ALL else hands.other(played, window)
        span_hands.play_parts(played, live_keys)
    players_with_part = {*real} | {play.player for play in piece.parts}
    for player in piece.players.values():
        if player.hand == "live" and player.standin and player.name not in players_with_part:
            hands.standin(player)
    ends = [gesture.stop for gesture in hands.gestures]
    for played, window in spans:
        within = _within(played, window)
        for strikes in played.strikes:
            targets = (t for t in strikes.to if (t.part, t.module) in assembly.mats)
            mats = [mat for target in targets for mat in assembly.members(target)]
            source = hands.sources.add(partial(_same_place, strikes.place))
            striking = Striking(played, timeline, strikes, mats, source, within, assembly)
            ends.append(striking.play(hands.collector))
    for link, (at, until) in zip(couplings, acting(piece), strict=True):
        if until == OVER:
            at, until = NEVER, None
        timeline.couple(link, at, until)
    return max(ends, default=0.0)


def _within(piece: Piece, window: Window) -> tuple[float, float]:
    """The instants of a window [s], in the engine's time."""
    if window is ALL:
        return ANY
    tempo = piece.tempo_map
    first = tempo.seconds(window.since) if window.since > -math.inf else 0.0
    last = tempo.seconds(window.until) if window.until < math.inf else math.inf
    return max(0.0, first), last


def _sounds(piece: Piece, timeline: _core.Timeline, takes: Takes) -> dict[str, tuple[int, float]]:
    """The inputs: the number and the length [s] of the file of each, by name."""
    found: dict[str, tuple[int, float]] = {}
    for name, take in piece.takes.items():
        if (own := take.input) is None:
            continue
        if own.highpass is not None and own.highpass >= 0.5 * piece.rate:
            message = f"take {quote(name)}: its highpass is not below half of the rate"
            place = take.places.get("highpass", take.place)
            takes.collector.error("E308", message, place)
        elif (samples := takes.sound(name)) is not None:
            how = {"gain": own.gain, "clamp": own.clamp}
            if own.channel is None:
                number, glide = input_number(name), own.glide or 0.0
                index = timeline.told_in(number, samples, **how, glide=glide)
            else:
                highpass = own.highpass
                index = timeline.sound_in(own.channel - 1, samples, **how, highpass=highpass)
            found[name] = index, len(samples) / piece.rate
    return found


def input_number(name: str) -> int:
    """The engine's number of an input whose values come by OSC: the same in every version."""
    return int.from_bytes(sha256(name.encode()).digest()[:8])


def _drives(piece: Piece, assembly: Assembly, hands: Hands, sounds: Mapping[str, int]) -> None:
    """ENX and ENF: imposed positions and forces, by a constant, a take or an input."""
    tempo = piece.tempo_map
    keys = [(name, key.modules, key.reach) for name, key in piece.keys.items()]
    instruments = [(name, i.modules, 1.0) for name, i in piece.instruments.items()]
    for name, modules, reach in (*keys, *instruments):
        for module in modules:
            if module.kind not in ("ENX", "ENF"):
                continue
            mat = assembly.mat(module.fields["to"])
            is_position = module.kind == "ENX"
            # Behind a lever positions are seen times s, forces divided by it.
            scale = reach if is_position else 1.0 / reach
            source, at = module.fields["from"], module.fields["at"]
            constant = source * scale if isinstance(source, float) else None
            sound = sounds.get(str(source))
            take = None
            if constant is None and sound is None:
                known = piece.takes.get(str(source))
                take = None if known is None or known.input else hands.takes.get(str(source))
                if take is None:
                    continue  # what is wrong with it was reported
            hands.timeline.drive(
                mat,
                "position" if is_position else "force",
                constant=constant,
                take=take,
                sound=sound,
                at=0.0 if at is None else tempo.seconds(tempo.resolve(at)),
                scale=scale * module.fields["scale"],
                own=module.fields["to"].part == name,
            )


def _frames(piece: Piece, end: float, collector: Collector) -> int:
    """⌈(end + tail)·rate⌉ frames; a whole number of frames is not rounded up by its last bit."""
    tail = piece.render.tail
    seconds = end + (LONGEST_TAIL if tail == "auto" else tail)
    if seconds > MAX_SECONDS:
        message = f"the piece lasts {seconds / 3600:.0f} hours; the maximum is 24 hours"
        collector.error("E308", message, piece.place)
        return 0
    frames = seconds * piece.rate
    nearest = int(frames + 0.5)
    return nearest if abs(frames - nearest) < 1e-6 else int(frames) + 1


def _place(piece: Piece, name: str | None) -> Place:
    """Where the module that the engine names is written, or taken from another file."""
    name = name or ""
    links = [("duet", duet.link, duet.link.place) for duet in piece.duet]
    keys = [(key.name, module, key.place) for key in piece.keys.values() for module in key.modules]
    others = [(i.name, module, i.place) for i in piece.instruments.values() for module in i.modules]
    for part, module, place in (*keys, *others, *links):
        full = ".".join(filter(None, (part, module.name)))
        if name == full or name.startswith(f"{full}."):
            return module.place if module.place.file == place.file else place
    return piece.place


def _same_place(place: Place) -> Place:
    return place


__all__ = [
    "Going",
    "Ready",
    "Span",
    "Stage",
    "StageError",
    "StagedGesture",
    "prepare",
    "stage",
]
