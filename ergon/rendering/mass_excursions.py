"""How far masses swing, and whether contacts close, in a piece that is played to its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any

from .bow_sticking import StickDetector, sticking_detector
from .render import frames_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.staging.probes import Point, ProbedLink, ProbedPiece

# Frames of a block: few enough that 256 points fit into the processor's cache.
_BLOCK_FRAMES = 1024


@dataclass(slots=True)
class Excursion:
    """The lowest and highest position of a point [m]."""

    point: Point
    low: float = inf
    high: float = -inf


@dataclass(slots=True)
class ContactClosings:
    """How often a contact closed, from frame `first_frame` to `last_frame`, and its deepest
    penetration [m].

    If it never closed the penetration is negative: its size is the least distance, at frame
    `deepest_frame`. `swapped_depth_max` is the deepest penetration [m] that the same motion has
    where the ends of the contact are swapped.
    """

    contact: ProbedLink
    n_closings: int = 0
    first_frame: int | None = None
    last_frame: int | None = None
    depth_max: float = -inf
    deepest_frame: int = 0
    is_closed: bool = False
    swapped_depth_max: float = -inf

    def take(self, frames: NDArray[np.float64], first_frame: int) -> None:
        """Go on with positions (n_frames, n_points) from frame `first_frame` on."""
        import numpy as np

        contact = self.contact
        contact_fields = contact.module.fields
        elongations = frames[:, contact.b.output_number] - frames[:, contact.a.output_number]
        gap = contact_fields["gap"]
        depth = -elongations - gap if contact_fields["side"] == "below" else elongations - gap
        self.swapped_depth_max = max(self.swapped_depth_max, -float(depth.min()) - 2.0 * gap)
        is_closed = depth > 0
        closing_indices = np.flatnonzero(
            is_closed & ~np.concatenate(([self.is_closed], is_closed[:-1]))
        )
        if closing_indices.size and self.first_frame is None:
            self.first_frame = first_frame + int(closing_indices[0])
        self.n_closings += len(closing_indices)
        if is_closed.any():
            self.last_frame = first_frame + int(np.flatnonzero(is_closed)[-1])
        self.is_closed = bool(is_closed[-1])
        deepest_index = int(np.argmax(depth))
        if depth[deepest_index] > self.depth_max:
            self.depth_max, self.deepest_frame = (
                float(depth[deepest_index]),
                first_frame + deepest_index,
            )


def measure_excursions(
    stage: Any, probed: ProbedPiece, progress: Callable[[int], None]
) -> tuple[list[Excursion], list[ContactClosings], list[StickDetector]]:
    """Run the stage of a probed piece to its end; what its points, contacts and bows did."""
    excursions = [Excursion(point) for point in probed.points]
    closings = [ContactClosings(contact) for contact in probed.contacts]
    bows = [bow for bow in map(sticking_detector, probed.friction_links) if bow is not None]
    first_frame = 0
    for block_frames in frames_of(stage.simulation, stage.n_analysed_frames, _BLOCK_FRAMES):
        for excursion, low_excursion, high_excursion in zip(
            excursions, block_frames.min(axis=0), block_frames.max(axis=0), strict=True
        ):
            excursion.low, excursion.high = (
                min(excursion.low, float(low_excursion)),
                max(excursion.high, float(high_excursion)),
            )
        for closing in closings:
            closing.take(block_frames, first_frame)
        for bow in bows:
            bow.take(block_frames, stage.rate)
        first_frame += len(block_frames)
        progress(first_frame)
    return excursions, closings, bows
