"""A staged piece: the network, the timeline, and the simulation that plays them."""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from ergon import _core
from ergon.instruments import native
from ergon.notation.text.errors import Collector, Diagnostic, quote
from ergon.notation.text.without_gc import without_gc
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.built_network import BuiltNetwork
from ergon.scores.staging.drawn_notes import DrawnNote
from ergon.scores.staging.hands import ErgonPlaces, StagedGesture
from ergon.scores.staging.listening import Listening
from ergon.scores.staging.live import LiveHand
from ergon.scores.staging.parameter_values import ModuleKey, Points
from ergon.scores.staging.planning import PlanWithNotes, TrialStore, Watched, make_plan
from ergon.scores.staging.preparing import PreparedPiece, Span, prepare
from ergon.scores.staging.refusals import place_of, stage_error
from ergon.scores.staging.stage_memory import StageMemory
from ergon.scores.staging.trial_strikes import put_trial_strikes
from ergon.scores.staging.version_glides import Glide

if TYPE_CHECKING:
    from ergon.scores.staging.live import RealHands

_STIFF_ADVICE = (
    "make its springs and contacts softer (a smaller K, or smaller constants of a law), strike or "
    "move it less hard, or write a higher `rates: {audio: …}`"
)
_STIFF_ADVICE_WITH_METHOD = (
    "make its springs and contacts softer (a smaller K, or smaller constants of a law), strike or "
    "move it less hard, write a higher `rates: {audio: …}`, or remove `method` from `accuracy`"
)
_TAIL_SECONDS_ANALYSED = 5.0  # [s] of a tail `auto` that is analysed


@dataclass(slots=True)
class Stage:
    """Everything that plays a piece. `diagnostics` are warnings and notes.

    `planned_accuracy` is the accuracy that the plan was made for.
    """

    piece: Piece
    built_network: BuiltNetwork
    simulation: _core.Simulation
    n_frames: int
    gestures: list[StagedGesture]
    ergon_places: ErgonPlaces
    diagnostics: list[Diagnostic]
    plan: _core.Plan | None = None
    is_plan_kept: bool = False
    live_hands: tuple[LiveHand, ...] = ()
    takes: Mapping[Hashable, _core.Take] = field(default_factory=dict)
    paths: Mapping[ModuleKey, Points] = field(default_factory=dict)  # of modules with automation
    paths_end: float = math.inf  # [s] up to which these paths are complete
    planned_accuracy: Accuracy | None = None
    # From this frame on a render may end when the sound has faded; None: it ends at `n_frames`.
    fade_start: int | None = None
    memory: StageMemory = field(default_factory=StageMemory)
    recalled_outputs: Sequence[RecalledOutputs] = ()  # frozen outputs, mixed with the computed ones
    timeline: _core.Timeline | None = None  # all events
    drawn_notes: Sequence[DrawnNote] = ()  # notes that draw or press until they end
    # Reports of an earlier simulation; this one was not run because its sound is stored.
    reports: Reports | None = None
    is_draft: bool = False  # planned for a low cost, whatever the accuracy

    @property
    def network(self) -> _core.Network:
        """The network of the modules."""
        return self.built_network.network

    @property
    def listening(self) -> Listening:
        """The taps of the network and the ways from them to channels."""
        return self.built_network.listening

    @property
    def rate(self) -> float:
        """Frames a second [Hz]."""
        return self.piece.rate

    @property
    def n_analysed_frames(self) -> int:
        """Frames that are analysed: all, or up to 5 s after the last event if the tail is
        `auto`.
        """
        if self.fade_start is None:
            return self.n_frames
        return min(self.n_frames, self.fade_start + int(_TAIL_SECONDS_ANALYSED * self.rate + 0.5))

    @property
    def n_channels(self) -> int:
        """Number of loudspeakers."""
        return self.listening.n_channels

    def mixer(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        parts: Collection[str] | None = None,
        is_wet: bool | None = None,
        unit: float = 1.0,
    ) -> _core.Mixer:
        """A new mixer of all instruments, or of some `parts`.

        `highpass` [Hz] is for routes without their own; `reference` is the ratio of full scale at
        which reference quantities are heard, None for samples in SI units. `is_wet`: True for the
        answer of rooms alone, False for all sound without it. Gains are in units of `unit`.
        """
        mixer = self.listening.mixer(
            self.rate,
            self.simulation.n_out,
            highpass=highpass,
            reference=reference,
            parts=parts,
            is_wet=is_wet,
            unit=unit,
        )
        for recalled in self.recalled_outputs:
            mixer.freeze(*recalled)
        return mixer

    def stems(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        is_split: bool = False,
    ) -> list[tuple[str, _core.Mixer]]:
        """A new mixer for every instrument that is heard, with all its notes.

        `is_split`: those that a room hears have two, without the room (`NAME-dry`) and of its
        answer alone (`NAME-wet`).
        """
        parts_with_room = {
            tap_route.part for tap_route in self.listening.tap_routes if tap_route.room is not None
        }
        stems = []
        for part_name, instrument_parts in self._stem_parts().items():
            is_wet_by_name: dict[str, bool | None] = {part_name: None}
            if is_split and not parts_with_room.isdisjoint(instrument_parts):
                is_wet_by_name = {f"{part_name}-dry": False, f"{part_name}-wet": True}
            for stem_name, is_wet in is_wet_by_name.items():
                mixer = self.mixer(
                    highpass=highpass, reference=reference, parts=instrument_parts, is_wet=is_wet
                )
                stems.append((stem_name, mixer))
        return stems

    def measured_stems(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> list[tuple[str, _core.Mixer, float]]:
        """For every instrument that is heard, a new mixer in a unit of its own, and that unit: a
        ratio.

        Its output does not change with the gain of the instrument's route.
        """
        stems = []
        for name, (parts, unit) in self._measured_parts().items():
            mixer = self.mixer(highpass=highpass, reference=reference, parts=parts, unit=unit)
            stems.append((name, mixer, unit))
        return stems

    def _measured_parts(self) -> dict[str, tuple[list[str], float]]:
        """The parts of each instrument, and the unit in which it is measured."""
        return {
            name: (parts, self.listening.largest_ratio(parts))
            for name, parts in self._stem_parts().items()
        }

    def _stem_parts(self) -> dict[str, list[str]]:
        family_by_part = self.piece.note_families()
        parts_by_family: dict[str, list[str]] = {}
        for part in self.listening.parts():
            parts_by_family.setdefault(family_by_part.get(part, part), []).append(part)
        return parts_by_family

    @property
    def mix_cost(self) -> float:
        """About how long mixing a frame takes [ns]."""
        return self.listening.cost

    def mix_key(
        self,
        tap_hashes: Sequence[str],
        *,
        highpass: float | None,
        reference: float | None,
        with_silent: bool = False,
    ) -> str:
        """A hash of all that the frames of `mixer` depend on, or its state `with_silent` outputs;
        `tap_hashes` are hashes of outputs.
        """
        return self.listening.mix_key(
            tap_hashes, highpass=highpass, reference=reference, with_silent=with_silent
        )

    def stem_keys(
        self,
        tap_hashes: Sequence[str],
        *,
        highpass: float | None,
        reference: float | None,
        with_silent: bool = False,
    ) -> list[str]:
        """A hash of all that the frames, or the state, of each mixer of `measured_stems` depend
        on.
        """
        return [
            self.listening.mix_key(
                tap_hashes,
                highpass=highpass,
                reference=reference,
                parts=parts,
                unit=unit,
                with_silent=with_silent,
            )
            for parts, unit in self._measured_parts().values()
        ]

    def fault_diagnostic(self, error: _core.DivergedError) -> Diagnostic:
        """A diagnostic for a part that became non-finite during the run, at the place where it is
        written.
        """
        return Diagnostic(
            "E401", str(error), place_of(self.piece, error.module), None, self._stiffness_advice
        )

    @property
    def _stiffness_advice(self) -> str:
        """The help text for a part that is too stiff for its steps."""
        accuracy = self.planned_accuracy
        is_chosen = accuracy is not None and accuracy.method is not None
        return _STIFF_ADVICE_WITH_METHOD if is_chosen else _STIFF_ADVICE

    def energy_gains(self) -> list[Diagnostic]:
        """Modules that have generated energy so far, each at the place where it is written
        (W404).
        """
        reports = self.simulation if self.reports is None else self.reports
        return [
            Diagnostic(
                "W404", gain.sentence, place_of(self.piece, gain.name), None, self._stiffness_advice
            )
            for gain in reports.gains()
        ]


class Reports(Protocol):
    """What a simulation reports of its parts: `_core.Simulation`."""

    def finer(self) -> list[_core.FinerPart]:
        """The parts with frames of more than one step."""

    def gains(self) -> list[_core.EnergyGain]:
        """Modules that made energy."""


# MATs that may be struck, by part, module and member (-1: the middle one), with the engine's
# number.
StrikePoints = Sequence[tuple[str, str, int, int]]


class RecalledOutputs(NamedTuple):
    """Outputs that were computed before, and the taps to which they are added.

    Their first frame is frame `begin_frame` of the engine.
    """

    outputs: _core.FrozenOutputs
    taps: tuple[int, ...]
    begin_frame: int


@dataclass(frozen=True, slots=True)
class StageTakeover:
    """A stage that takes over from the running stage `running_stage`, at frame `start_frame`.

    `spans` is what parts of this piece and of earlier ones play; None: all of it. `glides` are
    parameters that are still gliding. `strike_points` are MATs that may be struck while it
    plays.
    """

    spans: Sequence[Span] | None = None
    running_stage: Stage | None = None
    start_frame: int = 0
    glides: Sequence[Glide] = ()
    strike_points: StrikePoints = ()


@without_gc
def stage(
    piece: Piece,
    *,
    seed: int | None = None,
    ledger: bool = False,
    record: bool = False,
    planned: bool = False,
    fine_contacts: bool = False,
    pins: Sequence[_core.IslandChoice] | None = None,
    store: TrialStore | None = None,
    threads: int = 1,
    real_hands: RealHands | None = None,
    silent: Container[str] = (),
    on_fault: Literal["stop", "mute"] = "stop",
    takeover: StageTakeover | None = None,
    correction: float = 1.0,
    is_draft: bool = False,
    recalls_sound: bool = False,
    is_seen: bool = False,
) -> Stage:
    """Build the network, timeline and simulation of a piece: module by module, or `planned` within
    its accuracy.

    A draft (`is_draft`) is planned with few trials, for the lowest cost; one that `recalls_sound`
    is planned exactly where that needs no new trial.

    A ledger is available only without a plan, and recording only if no ergon strikes inside a body.
    With `fine_contacts` and without a plan, contacts are computed several times a frame. `pins` are
    the choices of an earlier plan, `store` keeps results of trials, `real_hands` has the players
    whose hands are real with their known positions, `silent` the instruments that are not listened
    to. `on_fault` says whether a diverging part ends the run or is muted. Work takes `correction`
    times as long as in the table of costs. With `is_seen`, unheard parts are computed too.
    `takeover` describes the takeover from another stage. Raises StageError with every mistake that
    the engine finds.
    """
    if seed is not None:
        piece = replace(piece, seed=seed)
    takeover = takeover or StageTakeover()
    old_stage = takeover.running_stage
    prepared = prepare(piece, real_hands, silent, takeover.spans, old_stage, takeover.start_frame)
    native.speed_up(prepared.network, prepared.n_frames)
    if takeover.spans is not None:
        prepared.timeline.open()
        put_trial_strikes(piece, prepared.built_network.assembly, prepared.timeline)
    _add_glides(piece, prepared, takeover)
    _add_strike_points(piece, prepared, takeover)
    plan, planning = None, None
    try:
        if planned:
            seen_parts = (*piece.keys, *piece.instruments) if is_seen else ()
            planning = make_plan(
                prepared.network,
                prepared.timeline,
                piece.accuracy,
                pins,
                store,
                prepared.memory.plan,
                is_foreseen=takeover.spans is None and not real_hands,
                correction=correction,
                is_draft=is_draft,
                recalls_sound=recalls_sound,
                watched=Watched(seen=seen_parts, seen_every=piece.motion_step_frames),
            )
            plan = prepared.memory.plan = planning.plan
            _report_planning(piece, planning, prepared.collector, is_seen=is_seen)
        elif fine_contacts:
            plan = _core.Plan.with_fine_contacts(prepared.network, prepared.timeline)
        simulation = _core.Simulation(
            prepared.network,
            prepared.timeline,
            plan=plan,
            start=takeover.start_frame,
            ledger=ledger,
            record=record,
            on_fault=on_fault,
            threads=threads,
        )
    except _core.EngineError as error:
        raise stage_error(piece, prepared.collector, error) from error
    return _make_stage(piece, prepared, simulation, plan, planning)


def _make_stage(
    piece: Piece,
    prepared: PreparedPiece,
    simulation: _core.Simulation,
    plan: _core.Plan | None,
    planning: PlanWithNotes | None,
) -> Stage:
    return Stage(
        piece,
        prepared.built_network,
        simulation,
        prepared.n_frames,
        prepared.hands.gestures,
        prepared.hands.ergon_places,
        prepared.collector.finish(),
        plan,
        planning is not None and planning.is_kept,
        prepared.live_hands,
        prepared.hands.takes.known_takes,
        prepared.paths,
        prepared.paths_until,
        None if planning is None else planning.accuracy,
        prepared.fade_start,
        prepared.memory,
        timeline=prepared.timeline,
        drawn_notes=prepared.drawn_notes,
        is_draft=planning is not None and planning.is_draft,
    )


def _add_glides(piece: Piece, prepared: PreparedPiece, takeover: StageTakeover) -> None:
    try:
        for glide in takeover.glides:
            if glide.module_key in prepared.paths:
                continue  # automation changes it
            glide.put(prepared.timeline, prepared.built_network.assembly)
    except _core.EngineError as error:
        raise stage_error(piece, prepared.collector, error) from error


def _add_strike_points(piece: Piece, prepared: PreparedPiece, takeover: StageTakeover) -> None:
    """Register the MATs that may be struck while the stage plays."""
    assembly = prepared.built_network.assembly
    try:
        for part_name, part_module, member, strike_number in takeover.strike_points:
            first_mat = assembly.mats.get((part_name, part_module))
            if first_mat is not None:  # the module may be missing in the network
                mat = prepared.network.centre(first_mat) if member < 0 else first_mat + member
                contact_time = _contact_time(piece, part_name, part_module)
                prepared.timeline.strike_point(mat, strike_number, lasts=contact_time)
    except _core.EngineError as error:
        raise stage_error(piece, prepared.collector, error) from error


def _contact_time(piece: Piece, part: str, module_name: str) -> float | None:
    """How long a stroke on a module lasts, if its instrument says so [s]."""
    instrument = piece.instruments.get(part)
    acts = () if instrument is None else instrument.acts
    struck_acts = (
        act for act in acts if any(target.module == module_name for target in act.targets)
    )
    return next((act.lasts for act in struck_acts), None)


def _report_planning(
    piece: Piece, planning: PlanWithNotes, collector: Collector, *, is_seen: bool
) -> None:
    for code, sentence in planning.notes:
        collector.error(code, f"accuracy: {sentence}", piece.place)
    _report_unused_rates(piece, planning.plan, collector)
    if is_seen and piece.motion_step_frames > 1:
        _report_motion(piece, planning.plan, collector)


def _report_unused_rates(piece: Piece, plan: _core.Plan, collector: Collector) -> None:
    """Report parts with a rate of their own that are computed at the audio rate all the same
    (N403).
    """
    for name, reason in dict.fromkeys(plan.stay()):
        part = piece.keys.get(name) or piece.instruments[name]
        message = f"{quote(name)} is computed at the audio rate, not at a rate of its own: {reason}"
        collector.error("N403", message, part.place)


def _report_motion(piece: Piece, plan: _core.Plan, collector: Collector) -> None:
    """Report parts that are only seen but computed at the audio rate, or that there are none
    (N403).
    """
    plan_rows = plan.seen()
    for plan_row in plan_rows:
        if plan_row.stays is not None:
            names = " + ".join(map(quote, plan_row.parts))
            message = (
                f"{names} is computed at the audio rate, not at that of motion: {plan_row.stays}"
            )
            collector.error("N403", message, piece.place)
    offered_rows = (row for row in plan.rows() if row.offered)
    if not plan_rows and all(piece.keys.keys() & set(row.parts) for row in offered_rows):
        message = (
            "no part goes at the rate of motion: all that moves is heard, is felt by a hand, or "
            "would be heard at that rate"
        )
        collector.error("N403", message, piece.place)
