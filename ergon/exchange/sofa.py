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
from ergon.exchange.sofa_space import (
    EARS,
    LISTENER,
    UP,
    VIEW,
    Places,
    SofaSpaceError,
    directions,
    is_right_first,
    read_places,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BYTES_MAX = 512 << 20  # bytes of a file
_VALUES_MAX = 1 << 26  # largest array, as in `sofa_reader.py`
_HEADER_BYTES_MAX = 4096  # bytes of the first line of an answer
_READER_SECONDS_MAX = 600.0  # clock time, where the system sets no limit on the reader
_DELAY_SECONDS_MAX = 0.1  # [s] between two responses; sound goes around a head in 1 ms
_EMITTER, _EMITTER_METRES_MAX = "EmitterPosition", 1e-3  # [m]
_CONVENTION = "SimpleFreeFieldHRIR"
_ARRAY_NAMES = (
    "SourcePosition",
    "Data.IR",
    "Data.SamplingRate",
    "Data.Delay",
    LISTENER,
    VIEW,
    UP,
    EARS,
    _EMITTER,
)
_READER_PATH = Path(__file__).with_name("sofa_reader.py")


class SofaError(ErgonError, ValueError):
    """The file does not hold responses of two ears that can be read."""


@dataclass(frozen=True, slots=True)
class HeadResponses:
    """`angles` (n, 2): azimuth and elevation [degrees]; `responses` (n, 2, n_samples), left first;
    `rate` [Hz]; `delays` (n, 2): how much later each response comes [s] (AES69, Data.Delay);
    `passed_over`: what is not read."""

    angles: NDArray[np.float64]
    responses: NDArray[np.float64]
    rate: float
    delays: NDArray[np.float64]
    passed_over: tuple[str, ...] = ()


def read(path: Path) -> HeadResponses:
    """Responses of a SimpleFreeFieldHRIR file. Raises SofaError and OSError."""
    if importlib.util.find_spec("h5py") is None:
        raise SofaError(f"SOFA files are read by h5py; {install_command('head')}")
    with open_regular(path) as sofa_file:
        if os.fstat(sofa_file.fileno()).st_size > _BYTES_MAX:
            raise SofaError(f"{path} is larger than {_BYTES_MAX >> 20} MB")
        return _reader_answer(sofa_file, path)


def _reader_answer(sofa_file: IO[bytes], path: Path) -> HeadResponses:
    """The answer of a reader with the open file as its stdin."""
    process = subprocess.Popen(
        [sys.executable, "-P", str(_READER_PATH)],
        stdin=sofa_file,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        # No plug-in for a filter is looked for (H5PLpublic.h), and one thread needs less memory.
        env={**os.environ, "HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"},
    )
    timer = Timer(_READER_SECONDS_MAX, process.kill)
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

    line = reader_answer.readline(_HEADER_BYTES_MAX)
    try:
        header = parse_json(line)
    except MalformedTextError:
        refusal_reason = (
            "reading it took too long, too much memory, or crashed the library; it is damaged"
        )
        raise SofaError(f"{path}: {refusal_reason}") from None
    if "error" in header:
        raise SofaError(f"{path}: {printable(header['error'])}")
    _check_arrays(header, path)
    arrays = {
        name: _answered_array(reader_answer, shape, path)
        for name, shape in zip(_ARRAY_NAMES, header["shapes"], strict=False)
    }
    measured_places, responses, rates, delays = (arrays[name] for name in _ARRAY_NAMES[:4])
    if not delays.size:
        delays = np.zeros((1, 2))
    rate = float(rates.flat[0])
    if not 1_000.0 <= rate <= 768_000.0:
        raise SofaError(f"{path}: a rate of {rate:g} Hz")
    if (rates != rate).any():
        raise SofaError(f"{path}: rates from {rates.min():g} to {rates.max():g} Hz; one is read")
    if (
        not (np.isfinite(measured_places).all() and np.isfinite(responses).all())
        or not responses.any()
    ):
        raise SofaError(f"{path}: responses are finite numbers, and not all 0")
    if delays.any():
        with np.errstate(over="ignore"):  # of a damaged file
            delays = delays * _samples_per_unit(header["units"][3], rate, path)
    if not (np.isfinite(delays).all() and np.ptp(delays) <= _DELAY_SECONDS_MAX * rate):
        refusal_reason = (
            f"its delays (Data.Delay, in samples) differ by more than {_DELAY_SECONDS_MAX:g} s"
        )
        raise SofaError(f"{path}: {refusal_reason}; the ears of a head are nearer")
    delay_seconds = np.broadcast_to(delays, (len(responses), 2)) / rate
    try:
        source, head_places, emitter_notes = _places_of(header, arrays)
        angles = directions(source, head_places)
        if is_right_first(head_places.get(EARS)):
            responses, delay_seconds = responses[:, ::-1], delay_seconds[:, ::-1]
    except SofaSpaceError as error:
        raise SofaError(f"{path}: {error}") from None
    passed_over = (*_distance_notes(source), *emitter_notes)
    return HeadResponses(angles, responses, rate, delay_seconds, passed_over)


def _samples_per_unit(units_text: str, rate: float, path: Path) -> float:
    """Samples in the unit of delays, which is a sample by AES69. Raises SofaError."""
    if units_text.rstrip("s") in ("", "sample"):
        return 1.0
    if units_text in ("second", "seconds", "s"):
        return rate
    raise SofaError(f"{path}: Data.Delay is in {printable(units_text)}, not in samples or seconds")


def _places_of(
    header: dict[str, Any], arrays: dict[str, NDArray[np.float64]]
) -> tuple[Places, dict[str, Places], tuple[str, ...]]:
    """Places of the sources, those of the head by name, and sentences on the emitter. Raises
    SofaSpaceError.
    """
    attributes = dict(
        zip(_ARRAY_NAMES, zip(header["types"], header["units"], strict=False), strict=False)
    )
    if VIEW in attributes and not any(attributes[UP]):
        attributes[UP] = attributes[VIEW]  # AES69 gives both vectors one type and unit
    source_name = _ARRAY_NAMES[0]
    source = read_places(source_name, arrays[source_name], *attributes[source_name], "")
    head_places = {
        name: read_places(name, arrays[name], *attributes[name], "cartesian")
        for name in (LISTENER, VIEW, UP, EARS)
        if name in arrays and arrays[name].size
    }
    emitter = arrays.get(_EMITTER)
    if emitter is None or not emitter.any():
        return source, head_places, ()
    return source, head_places, _emitter_notes(emitter, *attributes[_EMITTER])


def _emitter_notes(rows: NDArray[np.float64], kind: str, units: str) -> tuple[str, ...]:
    import numpy as np

    try:
        points = read_places(_EMITTER, rows, kind, units, "cartesian").points(_EMITTER)
    except SofaSpaceError as error:
        return (f"{_EMITTER}: {error}",)
    with np.errstate(over="ignore"):  # of a damaged file
        distance = float(np.linalg.norm(points, axis=1).max())
    if distance <= _EMITTER_METRES_MAX:
        return ()
    return (f"{_EMITTER}, {distance:.3g} m off: sources are read at {_ARRAY_NAMES[0]}",)


def _distance_notes(source: Places) -> tuple[str, ...]:
    import numpy as np

    distances = source.rows[:, 2]
    if source.kind == "cartesian":
        distances = np.linalg.norm(source.rows, axis=1)
    low, high = float(distances.min()), float(distances.max())
    if high - low <= 1e-3 * high:
        return ("distances",)
    return (f"distances, {low:.3g} to {high:.3g} m: a direction is heard as from all of them",)


def _check_arrays(header: dict[str, Any], path: Path) -> None:
    """Raise SofaError unless the arrays are those of responses at two ears."""
    convention, (place_shape, array_shape, rates, delays) = (
        header["convention"],
        header["shapes"][:4],
    )
    if convention.lower() != _CONVENTION.lower():
        convention_text = printable(convention) or "no"
        raise SofaError(f"{path} is of {convention_text} convention; a head is {_CONVENTION}")
    if len(array_shape) != 3 or array_shape[1] != 2 or array_shape[0] < 4 or array_shape[2] < 8:
        sizes_text = " by ".join(map(str, array_shape))
        raise SofaError(
            f"{path}: responses are {sizes_text}; expected (directions, 2 ears, samples)"
        )
    if place_shape != [array_shape[0], 3]:
        sizes_text = " by ".join(map(str, place_shape))
        raise SofaError(f"{path}: {sizes_text} directions for {array_shape[0]} responses")
    if delays not in ([0], [1, 2], [array_shape[0], 2]):
        sizes_text = " by ".join(map(str, delays))
        raise SofaError(
            f"{path}: its delays (Data.Delay) are {sizes_text}; expected 1 or {array_shape[0]} by 2"
        )
    if not 1 <= math.prod(rates) <= _VALUES_MAX or any(
        math.prod(shape) > _VALUES_MAX for shape in header["shapes"]
    ):
        raise SofaError(f"{path}: it has no rate, or more responses than are read")


def _answered_array(
    reader_answer: IO[bytes], array_shape: list[int], path: Path
) -> NDArray[np.float64]:
    import numpy as np

    size = 8 * math.prod(array_shape)
    array_data = reader_answer.read(size)
    if len(array_data) < size:
        raise SofaError(f"{path}: reading it broke off; it is damaged")
    return np.frombuffer(array_data, "<f8").reshape(array_shape)
