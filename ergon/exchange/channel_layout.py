"""What the channels of a sound file are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.space.directions import Angles


@dataclass(frozen=True, slots=True)
class ChannelLayout:
    """What the channels of a file are: loudspeakers, or Ambisonics of an order (ACN, SN3D).

    `gains`: factors of all channels, empty where each is 1; `notes`: sentences on what of the
    description changes the sound, or is not read.
    """

    speakers: tuple[Angles, ...] = ()
    order: int | None = None
    effects: tuple[int, ...] = ()  # channels from 0 for low-frequency effects, no loudspeakers
    gains: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def n_channels(self) -> int:
        """Number of these channels."""
        if self.order is not None:
            return (self.order + 1) ** 2
        return len(self.speakers) + len(self.effects)
