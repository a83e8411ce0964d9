"""Measured responses of heads from SOFA files (AES69): impulse responses at two ears by direction.

The format is HDF5, which h5py reads; it is an extra.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command
from ergon.common.regular import read_bounded

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_MOST = 512 << 20  # bytes of a file
_MOST_VALUES = 1 << 27  # values of a data set in memory
_CONVENTIONS = ("SimpleFreeFieldHRIR", "SimpleFreeFieldHRTF")


class SofaError(ErgonError, ValueError):
    """The file does not hold responses of two ears that can be read."""


@dataclass(frozen=True, slots=True)
class HeadResponses:
    """`angles` (n, 2): azimuth and elevation [degrees]; `responses` (n, 2, n_samples), left first;
    `rate` [Hz]."""

    angles: NDArray[np.float64]
    responses: NDArray[np.float64]
    rate: float


def read(path: Path) -> HeadResponses:
    """Responses of a SimpleFreeFieldHRIR file. Raises SofaError and OSError."""
    try:
        import h5py
    except ImportError:
        raise SofaError(f"SOFA files are read by h5py; {install_command('head')}") from None
    data = read_bounded(path, _MOST)
    if len(data) > _MOST:
        raise SofaError(f"{path} is larger than {_MOST >> 20} MB")
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            return _responses(file, path)
    except (IndexError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
        if isinstance(error, SofaError):
            raise
        raise SofaError(f"{path} is not a SOFA file that can be read: {error}") from None


def _responses(file: Any, path: Path) -> HeadResponses:
    import numpy as np

    said = _text(file.attrs.get("SOFAConventions", b""))
    if said not in _CONVENTIONS[:1]:
        raise SofaError(f"{path} is of {said or 'no'} convention; a head is {_CONVENTIONS[0]}")
    if _text(file["SourcePosition"].attrs.get("Type", b"spherical")) != "spherical":
        raise SofaError(f"{path}: directions are read as angles, here they are cartesian")
    places = _values(file, "SourcePosition", path)
    responses = _values(file, "Data.IR", path)
    rate = float(_values(file, "Data.SamplingRate", path).ravel()[0])
    shape = responses.shape
    if len(shape) != 3 or shape[1] != 2 or shape[0] < 4 or shape[2] < 8:
        raise SofaError(f"{path}: responses are {shape}; expected (directions, 2 ears, samples)")
    if places.shape != (shape[0], 3):
        raise SofaError(f"{path}: {len(places)} directions for {shape[0]} responses")
    if not 1_000.0 <= rate <= 768_000.0:
        raise SofaError(f"{path}: a rate of {rate:g} Hz")
    if not (np.isfinite(places).all() and np.isfinite(responses).all()) or not responses.any():
        raise SofaError(f"{path}: responses are finite numbers, and not all 0")
    return HeadResponses(places[:, :2], responses, rate)


def _values(file: Any, name: str, path: Path) -> NDArray[np.float64]:
    import numpy as np

    found = file[name]
    if found.size > _MOST_VALUES:
        raise SofaError(f"{path}: {name} has {found.size:,} values")
    return np.asarray(found[...], np.float64)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
