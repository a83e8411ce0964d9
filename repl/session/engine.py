"""The engine of a session: its protocol, and one that its caller steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.live.force_bounds import HandForceBounds
    from ergon.scores.staging.stage import Stage
    from ergon.scores.staging.version_glides import Glide


@dataclass(frozen=True, slots=True)
class Change:
    """A change of what plays, from `frame` on, which is a multiple of the engine's tick.

    `stage` takes over from `old_stage`, or begins anew if it `resets`; `gains` are the ratios of
    groups of routes; `damping_t60` [s] is a T60 added to all that sounds; `force_bounds` are the
    forces that real hands may get from the stage.
    """

    frame: int
    stage: Stage
    old_stage: Stage
    resets: bool = False
    gains: Mapping[int, float] = field(default_factory=dict)
    damping_t60: float | None = None
    force_bounds: Sequence[HandForceBounds] = ()

    @property
    def is_gain_change(self) -> bool:
        """Whether it changes gains alone: the stage goes on."""
        return self.stage is self.old_stage and not self.resets and self.damping_t60 is None

    @property
    def needs_new_mixer(self) -> bool:
        """Whether the change needs a new mixer."""
        new_stage, old_stage = self.stage, self.old_stage
        return (
            new_stage.network is not old_stage.network
            or new_stage.recalled_outputs != old_stage.recalled_outputs
        )


@dataclass(frozen=True, slots=True)
class GuidedPath:
    """A path that guides a hand: `positions` (n_ticks,) [m] has the position at each tick.

    `forces` (n_ticks,) [N] drive a real key along it; empty: none do. `strength_steps` are (tick,
    share of stiffness, share of viscosity): from that tick on these shares hold, 0 to 1.
    """

    positions: NDArray[np.float64]
    strength_steps: Sequence[tuple[int, float, float]]
    forces: NDArray[np.float64] | tuple[()] = ()


@dataclass(frozen=True, slots=True)
class RecordedHand:
    """A hand whose movement is known: `positions` (n_ticks,) [m] of the key, tick by tick.

    `index` is its number in the simulation, `lever_ratio` the factor between key and scene. After
    the last tick the key stays where it is.
    """

    index: int
    lever_ratio: float
    positions: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EngineStatus:
    """Load as a share of real time, late ticks, peaks of channels as ratios.

    `disconnected` are the players whose keys are disconnected.
    """

    load: float = 0.0
    late_ticks: int = 0
    peaks: Sequence[float] = ()
    disconnected: frozenset[str] = frozenset()
    is_let_go: bool = False  # no force is sent, by `let_go` or by a signal
    troubles: Sequence[str] = ()  # what is wrong, in a few words each


@dataclass(frozen=True, slots=True)
class EngineEvent:
    """A change, a strike or an input value that took effect or came too late, by its ticket; or a
    sentence for the player.

    `is_real_by_player` says by player whether a person moves the key from this frame on.
    """

    frame: int
    ticket: int | None = None
    is_late: bool = False
    # The ticket of a strike or a value, which acted unless it `is_late`.
    act_ticket: int | None = None
    sentence: str = ""
    is_real_by_player: Mapping[str, bool] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SoundFileStatus:
    """The state of a recorded sound file: its first frame in the session (None: not begun), its
    number of frames, how many of them are silence because the disk was too slow, whether it is
    closed, and why it could not be written.
    """

    first_frame: int | None
    n_frames: int
    n_missing: int
    has_ended: bool
    error: str | None = None


class Engine(Protocol):
    """The engine as a session needs it."""

    @property
    def n_channels(self) -> int:
        """Number of channels of the sound, which no change alters."""

    @property
    def tick_frames(self) -> int:
        """Frames of a tick."""

    @property
    def frame(self) -> int:
        """Frames computed so far."""

    def force_bounds(
        self,
        stage: Stage,
        start: int,
        glides: Sequence[Glide],
        bounds_before: Sequence[HandForceBounds],
    ) -> Sequence[HandForceBounds]:
        """The forces that real hands may get from a stage that takes over at frame `start`.

        Raises NotTakenError where a key cannot bear the stage.
        """

    def change(self, change: Change) -> int:
        """Request a change; returns its ticket."""

    def revoke(self, frame: int) -> None:
        """Withdraw the changes of the stage that are due at `frame` or later and were not made yet.

        Each is reported as late, by rising tickets; later requests stay. Raises EngineError if too
        many commands wait.
        """

    def guide(self, frame: int, paths: Mapping[str, GuidedPath]) -> int:
        """Guide players' hands along new paths from `frame` on; returns the ticket."""

    def strike(self, point: int, impulse: float) -> int | None:
        """Strike a point of the running stage by an impulse [N·s], at the next tick; any thread may
        call it.

        Returns a ticket, which an event reports; None if too many strikes wait.
        """

    def set_input(self, number: int, value: float) -> int | None:
        """Set an input whose values are sent, full scale 1; otherwise like `strike`."""

    def record_sound(self, path: Path) -> None:
        """Write the sound that is heard to a new file, from the next tick on.

        Raises NotTakenError, EngineError.
        """

    def end_sound(self) -> None:
        """End the file of `record_sound`."""

    def sound_file_status(self) -> SoundFileStatus | None:
        """The state of the file of `record_sound`; None where there was none."""

    def set_faders(self, gains: Mapping[int, float]) -> None:
        """Set the faders of groups of routes at the beginning, as ratios."""

    def events(self) -> Sequence[EngineEvent]:
        """Events since the last call."""

    def silences(self) -> Sequence[tuple[int, bool]]:
        """Begins and ends of the silence of panics since the last call: (frame, whether it
        begins).
        """

    def status(self) -> EngineStatus:
        """Load, late ticks, peaks, disconnected keys, and troubles."""

    def panic(self) -> None:
        """Silence sound within 5 ms, and end every force."""

    def let_go(self) -> None:
        """End every force; the sound goes on."""

    def release(self) -> None:
        """Switch sound and force on again."""

    def close(self) -> None:
        """End the engine."""


class SteppedEngine:
    """An engine whose frames are computed when its caller asks for them.

    `render` uses it for journals; a live engine must give the same samples.
    """

    def __init__(
        self,
        stage: Stage,
        *,
        tick_frames: int,
        highpass: float | None,
        reference: float | None = None,
        hands: Sequence[RecordedHand] = (),
    ) -> None:
        """Begin with a stage at frame 0, in which the hands move as `hands` did."""
        self.tick_frames = tick_frames
        self._hands = hands
        self.frame = 0
        self.n_channels = stage.n_channels
        self._simulation: _core.Simulation = stage.simulation
        self._highpass, self._reference = highpass, reference
        self._mixer = stage.mixer(highpass=highpass, reference=reference)
        self._changes: list[tuple[int, Change]] = []
        self._events: list[EngineEvent] = []
        self._acts: list[Callable[[_core.Simulation], bool]] = []  # acts of this frame
        self._n_tickets = 0

    def force_bounds(
        self,
        stage: Stage,
        start: int,
        glides: Sequence[Glide],
        bounds_before: Sequence[HandForceBounds],
    ) -> Sequence[HandForceBounds]:
        """Do nothing: no hand is real here."""
        return ()

    def change(self, change: Change) -> int:
        """Request a change; one whose frame has passed is reported as late and not made."""
        self._n_tickets += 1
        if change.frame < self.frame:
            self._events.append(EngineEvent(self.frame, self._n_tickets, is_late=True))
        else:
            self._changes.append((self._n_tickets, change))
            self._changes.sort(key=lambda entry: (entry[1].frame, entry[0]))
        return self._n_tickets

    def revoke(self, frame: int) -> None:
        """Withdraw the changes that are due at `frame` or later; each is reported as late."""
        revoked_changes = [
            change
            for change in self._changes
            if change[1].frame >= frame and not change[1].is_gain_change
        ]
        self._changes = [change for change in self._changes if change not in revoked_changes]
        for ticket, _ in sorted(revoked_changes, key=lambda entry: entry[0]):
            self._events.append(EngineEvent(self.frame, ticket, is_late=True))

    def guide(self, frame: int, paths: Mapping[str, GuidedPath]) -> int:
        """Do nothing: no hand is real here."""
        self._n_tickets += 1
        return self._n_tickets

    def strike(self, point: int, impulse: float) -> int:
        """Strike a point of the running stage by an impulse [N·s], at the next frame."""
        return self._act_now(lambda simulation: simulation.strike(point, impulse))

    def set_input(self, number: int, value: float) -> int:
        """Set an input whose values are sent, full scale 1, from the next frame on."""
        return self._act_now(lambda simulation: simulation.tell(number, value))

    def _act_now(self, action: Callable[[_core.Simulation], bool]) -> int:
        self._do_due_changes()  # a change of this frame comes before it
        self._n_tickets += 1
        is_missed = not action(self._simulation)
        self._acts.append(action)
        self._events.append(EngineEvent(self.frame, act_ticket=self._n_tickets, is_late=is_missed))
        return self._n_tickets

    def record_sound(self, path: Path) -> None:
        """Refuse: here sound is rendered, not played. Raises NotTakenError."""
        raise NotTakenError("no sound output is open: `ergon render` writes a file")

    def end_sound(self) -> None:
        """Do nothing: no sound is recorded."""

    def sound_file_status(self) -> SoundFileStatus | None:
        """None: no sound is recorded."""
        return None

    def set_faders(self, gains: Mapping[int, float]) -> None:
        """Set the faders of groups of routes at the beginning, as ratios."""
        for group, gain in gains.items():
            self._mixer.set_gain(group, gain)

    def events(self) -> list[EngineEvent]:
        """Events since the last call."""
        events, self._events = self._events, []
        return events

    def process(self, n_frames: int) -> NDArray[np.float64]:
        """The next frames (n_frames, n_channels), before the gain and the limiter."""
        import numpy as np

        mixed_frames = np.zeros((n_frames, self.n_channels))
        n_done_frames = 0
        while n_done_frames < n_frames:
            self._do_due_changes()
            self._acts = []
            stop_frame = min(
                [
                    self.frame + n_frames - n_done_frames,
                    *(change.frame for _, change in self._changes[:1]),
                ]
            )
            if self._hands:
                stop_frame = min(stop_frame, self._hold_hands())
            n_block_frames = stop_frame - self.frame
            frames = np.zeros((n_block_frames, self._simulation.n_out))
            self._simulation.process(frames)
            self._mixer.process(
                frames, mixed_frames[n_done_frames : n_done_frames + n_block_frames]
            )
            n_done_frames += n_block_frames
            self.frame = stop_frame
        return mixed_frames

    def _hold_hands(self) -> int:
        """Hold each hand where it is in this tick; returns the first frame of the next one."""
        tick = self.frame // self.tick_frames
        for hand in self._hands:
            hand_position = hand.positions[min(tick, len(hand.positions) - 1)]
            self._simulation.hold(hand.index, float(hand_position) * hand.lever_ratio)
        return (tick + 1) * self.tick_frames

    def _do_due_changes(self) -> None:
        while self._changes and self._changes[0][1].frame == self.frame:
            ticket, change = self._changes.pop(0)
            is_done = self._do_change(change)
            self._events.append(EngineEvent(self.frame, ticket, is_late=not is_done))

    def _do_change(self, due_change: Change) -> bool:
        """Make a change; False, with nothing changed, if another stage plays than it replaces."""
        if not due_change.is_gain_change:
            is_other_stage = due_change.old_stage.simulation is not self._simulation
            if is_other_stage and not due_change.resets:
                return False
            self._do_takeover(due_change)
        for group, gain in due_change.gains.items():
            self._mixer.set_gain(group, gain)
        return True

    def _do_takeover(self, due_change: Change) -> None:
        new_simulation = due_change.stage.simulation
        new_outputs = [] if due_change.resets else new_simulation.take_over(self._simulation)
        if due_change.needs_new_mixer:
            mixer = due_change.stage.mixer(highpass=self._highpass, reference=self._reference)
            mixer.take_over(self._mixer, new_outputs)
            self._mixer = mixer
        self._simulation = new_simulation
        new_simulation.damp(due_change.damping_t60)
        for act in self._acts if due_change.resets else ():  # nothing was taken over
            act(new_simulation)

    def silences(self) -> Sequence[tuple[int, bool]]:
        """None: nothing is silenced here."""
        return ()

    def status(self) -> EngineStatus:
        """The state of an engine that is never late."""
        return EngineStatus()

    def panic(self) -> None:
        """Do nothing: no sound card is open."""

    def let_go(self) -> None:
        """Do nothing: no hand is real here."""

    def release(self) -> None:
        """Do nothing: nothing was silenced."""

    def close(self) -> None:
        """Do nothing: nothing is open."""
