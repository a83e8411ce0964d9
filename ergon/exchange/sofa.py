"""Measured responses of heads from SOFA files (AES69): impulse responses at two ears by direction.

The format is HDF5, which h5py reads; it is an extra. It reads in a process of its own with bounds
(`sofa_reader.py`), because libhdf5 crashes on damaged files.
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import IO, TYPE_CHECKING, Any

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command
from ergon.common.regular import open_regular
from ergon.common.structured import MalformedTextError, parse_json
from ergon.common.terminal import printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BYTES_MAX = 512 << 20  # bytes of a file
_VALUES_MAX = 1 << 26  # largest array, as in `sofa_reader.py`
_HEAD_MAX = 4096  # bytes of the first line of an answer
_SECONDS = 600.0  # clock time, where the system sets no limit on the reader
_DELAY_MAX = 0.1  # [s] between two responses; sound goes around a head in 1 ms
_CONVENTION = "SimpleFreeFieldHRIR"
_READER = Path(__file__).with_name("sofa_reader.py")


class SofaError(ErgonError, ValueError):
    """The file does not hold responses of two ears that can be read."""


@dataclass(frozen=True, slots=True)
class HeadResponses:
    """`angles` (n, 2): azimuth and elevation [degrees]; `responses` (n, 2, n_samples), left first;
    `rate` [Hz]; `delays` (n, 2): how much later each response comes [s] (AES69, Data.Delay)."""

    angles: NDArray[np.float64]
    responses: NDArray[np.float64]
    rate: float
    delays: NDArray[np.float64]


def read(path: Path) -> HeadResponses:
    """Responses of a SimpleFreeFieldHRIR file. Raises SofaError and OSError."""
    if importlib.util.find_spec("h5py") is None:
        raise SofaError(f"SOFA files are read by h5py; {install_command('head')}")
    with open_regular(path) as sofa_file:
        if os.fstat(sofa_file.fileno()).st_size > _BYTES_MAX:
            raise SofaError(f"{path} is larger than {_BYTES_MAX >> 20} MB")
        return _read(sofa_file, path)


def _read(sofa_file: IO[bytes], path: Path) -> HeadResponses:
    """The answer of a reader with the open file as its stdin."""
    process = subprocess.Popen(
        [sys.executable, "-P", str(_READER)],
        stdin=sofa_file,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # No plug-in for a filter is looked for (H5PLpublic.h), and one thread needs less memory.
        env={**os.environ, "HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"},
    )
    timer = Timer(_SECONDS, process.kill)
    timer.start()
    try:
        assert process.stdout is not None
        return responses_of(process.stdout, path)
    finally:
        timer.cancel()
        process.kill()
        process.communicate()


def responses_of(reader_answer: IO[bytes], path: Path) -> HeadResponses:
    """The responses in the answer of a reader. Raises SofaError."""
    import numpy as np

    line = reader_answer.readline(_HEAD_MAX)
    try:
        header = parse_json(line)
    except MalformedTextError:
        refusal_reason = (
            "reading it took too long, too much memory, or crashed the library; it is damaged"
        )
        raise SofaError(f"{path}: {refusal_reason}") from None
    if "error" in header:
        raise SofaError(f"{path}: {printable(header['error'])}")
    _check(header, path)
    measured_places, responses, rates, delays = (
        _array(reader_answer, shape, path) for shape in header["shapes"]
    )
    rate = float(rates.flat[0])
    if not 1_000.0 <= rate <= 768_000.0:
        raise SofaError(f"{path}: a rate of {rate:g} Hz")
    if (
        not (np.isfinite(measured_places).all() and np.isfinite(responses).all())
        or not responses.any()
    ):
        raise SofaError(f"{path}: responses are finite numbers, and not all 0")
    if not (np.isfinite(delays).all() and np.ptp(delays) <= _DELAY_MAX * rate):
        refusal_reason = f"its delays (Data.Delay, in samples) differ by more than {_DELAY_MAX:g} s"
        raise SofaError(f"{path}: {refusal_reason}; the ears of a head are nearer")
    delay_seconds = np.broadcast_to(delays, (len(responses), 2)) / rate
    directions = measured_places[:, :2]
    if header["type"] == "cartesian":
        directions = _directions(measured_places, path)
    return HeadResponses(directions, responses, rate, delay_seconds)


def _directions(places: NDArray[np.float64], path: Path) -> NDArray[np.float64]:
    """Azimuth and elevation [degrees] of places: x to the front, y to the left (AES69)."""
    import numpy as np

    x, y, z = places.T
    if not places.any(axis=1).all():
        raise SofaError(f"{path}: a direction is the place of the head itself")
    angles = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=1)
    return angles * (180.0 / np.pi)


def _check(header: dict[str, Any], path: Path) -> None:
    """Raise SofaError unless the arrays are those of responses at two ears."""
    convention, (place_shape, array_shape, rates, delays) = header["convention"], header["shapes"]
    if convention != _CONVENTION:
        convention_text = printable(convention) or "no"
        raise SofaError(f"{path} is of {convention_text} convention; a head is {_CONVENTION}")
    if header["type"] not in ("spherical", "cartesian"):
        raise SofaError(
            f"{path}: directions are {printable(header['type'])}, not spherical or cartesian"
        )
    if header["type"] == "spherical" and "rad" in header.get("units", "").lower():
        raise SofaError(f"{path}: directions are read in degrees, here they are in radians")
    if len(array_shape) != 3 or array_shape[1] != 2 or array_shape[0] < 4 or array_shape[2] < 8:
        sizes_text = " by ".join(map(str, array_shape))
        raise SofaError(
            f"{path}: responses are {sizes_text}; expected (directions, 2 ears, samples)"
        )
    if place_shape != [array_shape[0], 3]:
        sizes_text = " by ".join(map(str, place_shape))
        raise SofaError(f"{path}: {sizes_text} directions for {array_shape[0]} responses")
    if delays not in ([1, 2], [array_shape[0], 2]):
        sizes_text = " by ".join(map(str, delays))
        raise SofaError(
            f"{path}: its delays (Data.Delay) are {sizes_text}; expected 1 or {array_shape[0]} by 2"
        )
    if not 1 <= math.prod(rates) <= _VALUES_MAX or math.prod(array_shape) > _VALUES_MAX:
        raise SofaError(f"{path}: it has no rate, or more responses than are read")


def _array(reader_answer: IO[bytes], array_shape: list[int], path: Path) -> NDArray[np.float64]:
    import numpy as np

    size = 8 * math.prod(array_shape)
    array_data = reader_answer.read(size)
    if len(array_data) < size:
        raise SofaError(f"{path}: reading it broke off; it is damaged")
    return np.frombuffer(array_data, "<f8").reshape(array_shape)
