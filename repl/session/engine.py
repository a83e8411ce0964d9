"""What sounds while lines are typed: a performance on hardware, or the same in steps, by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon import _core
    from ergon.live.guard import HandForceBounds
    from ergon.scores.staging.gliding import Glide
    from ergon.scores.staging.stage import Stage


@dataclass(frozen=True, slots=True)
class Change:
    """What is different from frame `at` on, a multiple of the engine's tick.

    `stage` takes over from what plays `before`, or where it `resets` begins anew; `gains` (ratios)
    are of groups of routes; `damp` [s] is the T60 that all is given besides its own; `bearings` are
    what real hands get of it.
    """

    at: int
    stage: Stage
    before: Stage
    resets: bool = False
    gains: Mapping[int, float] = field(default_factory=dict)
    damp: float | None = None
    bearings: Sequence[HandForceBounds] = ()


@dataclass(frozen=True, slots=True)
class Led:
    """What leads a hand: `path` (n_ticks,) [m] is where to, tick by tick.

    `steps`: after how many ticks which shares of its guide's stiffness and viscosity act (0 to 1).
    """

    path: NDArray[np.float64]
    steps: Sequence[tuple[int, float, float]]


@dataclass(frozen=True, slots=True)
class Look:
    """How it goes: load as a share of real time, late ticks, peaks of channels as ratios.

    `away` are players whose keys are gone.
    """

    load: float = 0.0
    late: int = 0
    peaks: Sequence[float] = ()
    away: frozenset[str] = frozenset()
    let_go: bool = False  # no force is sent, by `let_go` or by a signal


@dataclass(frozen=True, slots=True)
class Told:
    """Something that happened: a change was done, or came too late; or a sentence to be read."""

    frame: int
    ticket: int | None = None
    is_late: bool = False
    sentence: str = ""


class Engine(Protocol):
    """What a session plays on."""

    @property
    def every(self) -> int:
        """Frames of a tick."""

    @property
    def frame(self) -> int:
        """Frames computed so far."""

    def bearings(
        self, stage: Stage, start: int, glides: Sequence[Glide], before: Sequence[HandForceBounds]
    ) -> Sequence[HandForceBounds]:
        """What real hands get of a stage that takes over at frame `start`. Raises NotTakenError."""

    def change(self, change: Change) -> int:
        """Ask for a change; its ticket."""

    def lead(self, at: int, leads: Mapping[str, Led]) -> int:
        """Lead hands of players otherwise from frame `at` on; a ticket."""

    def faders(self, gains: Mapping[int, float]) -> None:
        """Where the faders of groups of routes stand at the beginning, as ratios."""

    def told(self) -> Sequence[Told]:
        """What happened since the last call."""

    def look(self) -> Look:
        """How it goes."""

    def panic(self) -> None:
        """Silence within 5 ms, no force."""

    def let_go(self) -> None:
        """No force."""

    def release(self) -> None:
        """Sound and force again."""

    def close(self) -> None:
        """End."""


class Steps:
    """The engine by hand: frames are computed when they are asked for.

    What `render` makes of a journal, and what a live engine must be equal to.
    """

    def __init__(self, stage: Stage, *, every: int, highpass: float | None) -> None:
        """Begin with a stage at frame 0."""
        self.every = every
        self.frame = 0
        self.n_channels = stage.n_channels
        self._simulation: _core.Simulation = stage.simulation
        self._highpass = highpass
        self._mixer = stage.mixer(highpass=highpass)
        self._coming: list[tuple[int, Change]] = []
        self._told: list[Told] = []
        self._tickets = 0

    def bearings(
        self, stage: Stage, start: int, glides: Sequence[Glide], before: Sequence[HandForceBounds]
    ) -> Sequence[HandForceBounds]:
        """No hand is real here."""
        return ()

    def change(self, change: Change) -> int:
        """Ask for a change; one whose frame has passed is told to be late, and not done."""
        self._tickets += 1
        if change.at < self.frame:
            self._told.append(Told(self.frame, self._tickets, is_late=True))
        else:
            self._coming.append((self._tickets, change))
            self._coming.sort(key=lambda one: (one[1].at, one[0]))
        return self._tickets

    def lead(self, at: int, leads: Mapping[str, Led]) -> int:
        """No hand is real here."""
        self._tickets += 1
        return self._tickets

    def faders(self, gains: Mapping[int, float]) -> None:
        """Where the faders of groups of routes stand at the beginning, as ratios."""
        for group, gain in gains.items():
            self._mixer.set_gain(group, gain)

    def told(self) -> list[Told]:
        """What happened since the last call."""
        told, self._told = self._told, []
        return told

    def process(self, n_frames: int) -> NDArray[np.float64]:
        """The next frames (n_frames, n_channels), before the gain and the limiter."""
        import numpy as np

        mixed = np.zeros((n_frames, self.n_channels))
        done = 0
        while done < n_frames:
            self._due()
            stop = min([self.frame + n_frames - done, *(one.at for _, one in self._coming[:1])])
            n = stop - self.frame
            frames = np.zeros((n, self._simulation.n_out))
            self._simulation.process(frames)
            self._mixer.process(frames, mixed[done : done + n])
            done += n
            self.frame = stop
        return mixed

    def _due(self) -> None:
        while self._coming and self._coming[0][1].at == self.frame:
            ticket, change = self._coming.pop(0)
            self._do(change)
            self._told.append(Told(self.frame, ticket))

    def _do(self, change: Change) -> None:
        new = change.stage.simulation
        outputs = [] if change.resets else new.take_over(self._simulation)
        if change.stage.network is not change.before.network:
            mixer = change.stage.mixer(highpass=self._highpass)
            mixer.take_over(self._mixer, outputs)
            self._mixer = mixer
        self._simulation = new
        for group, gain in change.gains.items():
            self._mixer.set_gain(group, gain)
        new.damp(change.damp)

    def look(self) -> Look:
        """Nothing is late that is done by hand."""
        return Look()

    def panic(self) -> None:
        """Nothing sounds here that could hurt."""

    def let_go(self) -> None:
        """No hand is here."""

    def release(self) -> None:
        """Nothing was silenced."""

    def close(self) -> None:
        """Nothing is open."""
