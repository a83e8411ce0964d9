"""What is heard and written: routes, the master, the file, and how exact it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from ergon.instruments.model import Layout
from ergon.notation.tables.shapes import Name
from ergon.notation.text.values import Place
from ergon.scores.reading.digest_marks import OMIT_EMPTY
from ergon.scores.reading.mixing import Fade, PanPath, Radiation, Room
from ergon.scores.reading.tones import Echo, Tone

REFERENCE_RATIO = 0.1  # share of full scale, -20 dBFS; see Output.reference


@dataclass(frozen=True, slots=True)
class Route:
    """From outputs of an instrument (`out` None: all) to channels (from 1); `gain` is a ratio."""

    part: str
    out: str | None
    to: tuple[int, ...] | Literal["nearest"]
    gain: float
    highpass: float | None
    place: Place
    pan: tuple[float, float] | None = field(
        default=None, metadata=OMIT_EMPTY
    )  # gains of two channels
    sends: tuple[tuple[Name, float], ...] = field(default=(), metadata=OMIT_EMPTY)  # rooms, ratios
    fade: Fade = field(default=(), metadata=OMIT_EMPTY)
    radiation: Radiation | None = field(default=None, metadata=OMIT_EMPTY)
    level: float | None = field(default=None, metadata=OMIT_EMPTY)  # of a stroke at mf [LUFS]
    # The ratio that leads to that level, once the instrument is known.
    level_ratio: float | None = field(default=None, metadata=OMIT_EMPTY)
    pan_path: PanPath = field(default=(), metadata=OMIT_EMPTY)  # in place of `pan`
    tones: tuple[Tone, ...] = field(default=(), metadata=OMIT_EMPTY)  # after the highpass
    echo: Echo | None = field(default=None, metadata=OMIT_EMPTY)

    @property
    def is_panned(self) -> bool:
        """Whether its sound has a place between two channels."""
        return self.pan is not None or bool(self.pan_path)

    @property
    def ratio(self) -> float:
        """The ratio of an output to its channels: the gain, and what leads to the level."""
        return self.gain if self.level_ratio is None else self.gain * self.level_ratio


@dataclass(frozen=True, slots=True)
class Master:
    """Processing of all channels together; levels are ratios of full scale."""

    normalise: float | None
    limit: float | None
    gain: float
    place: Place
    fade: Fade = field(default=(), metadata=OMIT_EMPTY)
    reference: float | Literal["SI"] | None = field(default=None, metadata=OMIT_EMPTY)
    loudness: float | None = field(default=None, metadata=OMIT_EMPTY)  # of the sum [LUFS]

    @property
    def is_levelled(self) -> bool:
        """Whether the level of the sum follows from what the whole piece measures."""
        return self.normalise is not None or self.loudness is not None


@dataclass(frozen=True, slots=True)
class Mix:
    """Loudspeakers and the ways to them."""

    channels: int
    layout: Layout | None
    routes: tuple[Route, ...]
    master: Master | None
    place: Place | None
    rooms: tuple[Room, ...] = field(default=(), metadata=OMIT_EMPTY)

    def reference(self, *, is_measured: bool = False) -> float | None:
        """The ratio of full scale at which reference quantities are heard.

        None if samples are in SI units: if the score says so, or if a file of floats is written
        (`is_measured`) whose master brings the sum to no level.
        """
        master = self.master
        if master is not None and master.reference is not None:
            return None if master.reference == "SI" else master.reference
        is_levelled = master is not None and master.is_levelled
        return None if is_measured and not is_levelled else REFERENCE_RATIO


@dataclass(frozen=True, slots=True)
class RenderSpec:
    """The file that `render` writes; `tail` [s] after the last event, or until it has faded."""

    file: str | None
    bits: Literal[16, 24, "float"]
    tail: float | Literal["auto"]
    channels: int | None
    place: Place | None


Method = Literal["ca", "modal", "ca2p", "bm4", "ieq"]
METHODS: tuple[Method, ...] = get_args(Method)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The required exactness: by one method, within an error [dB], or within cents up to a pitch.

    Without any of these, errors stay inaudible. `upto` [Hz]; `cpu` is the most work, 1.0 one
    core at real time. `is_unguarded`: no frame of CA is computed finer, even if links stiffen
    too much.
    """

    method: Method | None = None
    error: float | None = None
    cents: float | None = None
    upto: float | None = None
    cpu: float | None = None
    is_unguarded: bool = field(default=False, metadata={"hash_omits_empty": True})
