"""Filters from the channels of a file to those it is folded to: loudspeakers, Ambisonics, two ears.

A `Field` is loudspeakers, or Ambisonics of an order (ACN, SN3D). Filters are (n_in, n_out,
n_taps); most have one tap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .ambisonics import allrad, channels, encoder, sn3d
from .directions import point, unit_vectors
from .panning import vbap

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .directions import Point
    from .head import Head

# Ambisonics goes to two ears, or two channels, by way of these virtual loudspeakers: of each ring
# their number, elevation and first azimuth [degrees].
_VIRTUAL_RINGS = ((12, 0.0, 0.0), (8, 35.0, 22.5), (4, 70.0, 45.0))


@dataclass(frozen=True, slots=True)
class Field:
    """Loudspeakers at places [m], or Ambisonics of an order."""

    speakers: tuple[Point, ...] = ()
    order: int | None = None

    @property
    def n_channels(self) -> int:
        """Number of these channels."""
        return len(self.speakers) if self.order is None else channels(self.order)


def to_field(source_field: Field, target_field: Field) -> NDArray[np.float64]:
    """Filters from one field to another, (n_in, n_out, 1). Raises ArrayError.

    Loudspeakers are panned to others by VBAP, and encoded as plane waves; Ambisonics is decoded by
    AllRAD. A lower order leaves channels out, a higher one has silent ones.
    """
    if source_field.order is None and target_field.order is None:
        if source_field.speakers == target_field.speakers:
            return np.eye(source_field.n_channels)[:, :, None]
        speaker_gains = vbap(
            unit_vectors(source_field.speakers), unit_vectors(target_field.speakers)
        )
    elif target_field.order is not None:
        speaker_gains = np.eye(source_field.n_channels, target_field.n_channels)
        if source_field.order is None:
            speaker_gains = encoder(target_field.order, unit_vectors(source_field.speakers))
    else:
        assert source_field.order is not None
        speaker_gains = _decoder(source_field.order, unit_vectors(target_field.speakers)).T
    return np.ascontiguousarray(speaker_gains[:, :, None])


def to_stereo(source_field: Field) -> NDArray[np.float64]:
    """Two channels by constant power, (n_in, 2, 1), by how far to the right each direction is.

    A stereo pair stays as it is, whatever its angle.
    """
    array, decoder = _directions(source_field)
    rightward_shares = array[:, 0]
    if source_field.order is None and len(array) == 2 and _are_mirrored(array):
        return np.eye(2)[np.argsort(rightward_shares)][:, :, None]
    side_gains = np.stack(
        [np.sqrt((1.0 - rightward_shares) / 2.0), np.sqrt((1.0 + rightward_shares) / 2.0)], 1
    )
    return _combine_filters(decoder, side_gains[:, :, None])


def _are_mirrored(array: NDArray[np.float64]) -> bool:
    """Whether two directions (2, 3) are a stereo pair: one the mirror image of the other."""
    mirrored = array[1] * (-1.0, 1.0, 1.0)
    return bool(abs(array[0] - mirrored).max() < 1e-6 and abs(array[0, 0]) > 0.1)


def to_ears(source: Field, head: Head, rate: float) -> NDArray[np.float64]:
    """Two ears, (n_in, 2, n_taps), at a rate [Hz]. Raises ArrayError."""
    array, decoder = _directions(source)
    return _combine_filters(decoder, head.pairs(array, rate))


def directions_of(source: Field) -> NDArray[np.float64]:
    """Directions from which two ears hear a field, (n, 3)."""
    return _directions(source)[0]


def _directions(source_field: Field) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Directions from which a field is heard, and the decoder of Ambisonics to them (n_directions,
    n_in).
    """
    if source_field.order is None:
        return unit_vectors(source_field.speakers), None
    array = unit_vectors(
        point(first_azimuth + 360.0 * k / n, elevation, 1.0)
        for n, elevation, first_azimuth in _VIRTUAL_RINGS
        for k in range(n)
    )
    return array, _decoder(source_field.order, array)


def _decoder(order: int, array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Decoder of SN3D channels, (n_directions, n_channels)."""
    return allrad(order, array) / sn3d(order)


def _combine_filters(
    decoder: NDArray[np.float64] | None, filters: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Filters of the channels, from filters (n, n_out, n_taps) of the directions they are decoded
    to.
    """
    if decoder is None:
        return np.ascontiguousarray(filters)
    combined_filters = np.zeros((decoder.shape[1], *filters.shape[1:]))
    for row, speaker_filter in zip(decoder, filters, strict=True):
        combined_filters += row[:, None, None] * speaker_filter
    return combined_filters
