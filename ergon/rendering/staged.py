"""What a render needs of a staged piece: a simulation, its length, its mixers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Mixer(Protocol):
    """Mixes outputs to loudspeakers: `_core.Mixer`."""

    def process(self, frames: NDArray[np.float64], mixed: NDArray[np.float64]) -> None:
        """Mix (n_frames, n_out) to (n_frames, n_channels)."""

    def state(self) -> bytes | None:
        """What later frames depend on, besides the outputs; None if that cannot be stored."""

    def set_state(self, state: bytes) -> None:
        """Go on after the frames that an equal mixer has mixed. Raises EngineError."""


class Simulation(Protocol):
    """Computes the outputs of a piece: `_core.Simulation`."""

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames."""


class Staged(Protocol):
    """What a render needs of a staged piece."""

    @property
    def simulation(self) -> Simulation:
        """The simulation, at frame 0."""

    @property
    def n_frames(self) -> int:
        """Length of the piece with its tail."""

    @property
    def rate(self) -> float:
        """Frames a second [Hz]."""

    @property
    def n_channels(self) -> int:
        """Number of loudspeakers that a mixer feeds."""

    def mixer(self, *, highpass: float | None = None, reference: float | None = None) -> Mixer:
        """A new mixer; `highpass` [Hz] applies to routes that set none of their own.

        `reference` is the ratio of full scale at which reference quantities are heard.
        """

    def stems(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        is_split: bool = False,
    ) -> Sequence[tuple[str, Mixer]]:
        """A new mixer for every player or instrument, with its name.

        `is_split`: two for each that a room hears, without the room and of its answer.
        """

    def measured_stems(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> Sequence[tuple[str, Mixer, float]]:
        """For every player or instrument, its name, a new mixer in a unit of its own, and that
        unit: a ratio.
        """


@runtime_checkable
class KeyedStage(Staged, Protocol):
    """A staged piece whose mix is recognised in a later render."""

    @property
    def mix_cost(self) -> float:
        """About how long mixing a frame takes [ns]."""

    def mix_key(
        self,
        taps: Sequence[str],
        *,
        highpass: float | None,
        reference: float | None,
        with_silent: bool = False,
    ) -> str:
        """A hash of all that the frames of `mixer` depend on, or its state `with_silent` outputs;
        `taps` are hashes of outputs.
        """

    def stem_keys(
        self,
        taps: Sequence[str],
        *,
        highpass: float | None,
        reference: float | None,
        with_silent: bool = False,
    ) -> Sequence[str]:
        """A hash of all that the frames, or the state, of each mixer of `measured_stems` depend
        on.
        """
