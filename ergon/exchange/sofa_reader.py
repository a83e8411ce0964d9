"""Reads the arrays of a SOFA file on stdin and writes them to stdout; runs as a process of its own.

libhdf5 crashes on damaged files, and a file may name other files that it would open. So this
process has bounds that the system keeps: memory, time, and no file that is not open already.

    python -P sofa_reader.py < FILE.sofa

The answer is a line of JSON, {"convention", "types", "units", "shapes"}, and the numbers of ARRAYS
one after the other as little-endian doubles, none of an array that the file lacks; or {"error": a
sentence without the name of the file}.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

if TYPE_CHECKING:
    import h5py

ARRAYS = ("SourcePosition", "Data.IR", "Data.SamplingRate", "Data.Delay", "ListenerPosition",
          "ListenerView", "ListenerUp", "ReceiverPosition", "EmitterPosition")  # fmt: skip
_REQUIRED_ARRAYS = ARRAYS[:3]  # files of before AES69 leave delays out, some writers the rest
VALUES_MAX = 1 << 26  # largest array: 12,000 directions, 2,800 samples, both ears
_PLACES_MAX = 1 << 20  # largest array of another kind
_MEMORY_BYTES_MAX = 2 << 30  # bytes of addresses: an array as it is read and as doubles is 1 GB
_CPU_SECONDS_MAX = 60  # processor time
_TEXT_CHARACTERS_MAX = 200  # characters of a text of the file

# Filters of the library itself (H5Zpublic.h); others would be loaded as code.
_FILTER_NAMES = {1: "deflate", 2: "shuffle", 3: "fletcher32", 5: "nbit", 6: "scaleoffset"}


class _RefusedError(Exception):
    """The file holds something that is not read; the message says what."""


def rehearse() -> None:
    """Read a small file from memory, so that every module that reading needs is loaded."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as sofa_file:
        sofa_file.attrs["SOFAConventions"] = np.bytes_("none")
        for name in ARRAYS:
            sofa_file.create_dataset(name, data=[[1.0]], compression="gzip", shuffle=True)
    _read(buffer)


def limit_process() -> None:
    """Bound the memory and the time of this process; it opens no file any more."""
    with contextlib.suppress(ImportError):  # Windows has no such limits
        import resource

        limits = {
            resource.RLIMIT_AS: _MEMORY_BYTES_MAX,
            resource.RLIMIT_CPU: _CPU_SECONDS_MAX,
            resource.RLIMIT_CORE: 0,
            resource.RLIMIT_FSIZE: 0,
            resource.RLIMIT_NOFILE: 0,
        }
        for resource_id, value in limits.items():
            hard = resource.getrlimit(resource_id)[1]
            soft = value if hard == resource.RLIM_INFINITY else min(value, hard)
            with contextlib.suppress(OSError, ValueError):
                resource.setrlimit(resource_id, (soft, soft))


def answer(sofa_source: BinaryIO, answer_target: BinaryIO) -> None:
    """Read a file and write the answer."""
    try:
        arrays, header = _read(sofa_source)
    except _RefusedError as error:
        arrays, header = [], {"error": str(error)}
    except MemoryError:
        arrays, header = [], {"error": "reading it takes more memory than is allowed"}
    except Exception as error:  # h5py turns errors of libhdf5 into exceptions of many types
        reason = " ".join(str(error).split())[:_TEXT_CHARACTERS_MAX]
        arrays, header = [], {"error": f"this is not a SOFA file that can be read: {reason}"}
    answer_target.write(json.dumps(header).encode() + b"\n")
    for array in arrays:
        answer_target.write(array.reshape(-1).view(np.uint8).data)
    answer_target.flush()


def _read(sofa_source: BinaryIO) -> tuple[list[np.ndarray[Any, Any]], dict[str, Any]]:
    import h5py

    with h5py.File(sofa_source, "r") as sofa_file, np.errstate(all="ignore"):
        datasets = [
            _checked_dataset(sofa_file, name)
            if name in _REQUIRED_ARRAYS or name in sofa_file
            else None
            for name in ARRAYS
        ]
        header = {
            "convention": _text_attribute(sofa_file, "SOFAConventions"),
            "types": [_text_attribute(dataset, "Type").lower() for dataset in datasets],
            "units": [_text_attribute(dataset, "Units").lower() for dataset in datasets],
        }
        arrays = [
            np.zeros(0, "<f8") if dataset is None else np.ascontiguousarray(dataset[...], "<f8")
            for dataset in datasets
        ]
        return arrays, {**header, "shapes": [array.shape for array in arrays]}


def _checked_dataset(sofa_file: h5py.File, data_name: str) -> h5py.Dataset:
    """A data set whose numbers lie in this file, and are packed by nothing but the library."""
    import h5py

    file_links, encoded_name = sofa_file.id.links, data_name.encode()
    if not file_links.exists(encoded_name):
        raise _RefusedError(f"it has no {data_name}")
    if file_links.get_info(encoded_name).type != h5py.h5l.TYPE_HARD:
        raise _RefusedError(f"its {data_name} is a link to another place, which is not followed")
    dataset = sofa_file[data_name]
    if not isinstance(dataset, h5py.Dataset):
        raise _RefusedError(f"its {data_name} is not an array")
    creation_properties = dataset.id.get_create_plist()
    if creation_properties.get_layout() == h5py.h5d.VIRTUAL:
        raise _RefusedError(
            f"its {data_name} is virtual: the numbers are in other files, not read here"
        )
    if creation_properties.get_external_count():
        raise _RefusedError(
            f"its {data_name} is external: the numbers are in other files, not read here"
        )
    for filter_index in range(creation_properties.get_nfilters()):
        filter_id = creation_properties.get_filter(filter_index)[0]
        if filter_id not in _FILTER_NAMES:
            message = (
                f"its {data_name} is compressed by filter {filter_id}, which is not built into "
                "HDF5; "
            )
            raise _RefusedError(message + "`h5repack -f GZIP=4 IN OUT` compresses it anew")
    if dataset.dtype.kind not in "fiu":
        raise _RefusedError(f"its {data_name} does not hold numbers")
    values_max = VALUES_MAX if data_name == "Data.IR" else _PLACES_MAX
    if dataset.size is None or dataset.size > values_max:
        count = f"{dataset.size or 0:,} values; at most {values_max:,} are read"
        raise _RefusedError(f"its {data_name} has {count}")
    return dataset


def _text_attribute(holder: Any, name: str) -> str:
    """A text of the file, without what fills its room; netCDF keeps texts in arrays of one."""
    value = None if holder is None else holder.attrs.get(name)
    if isinstance(value, np.ndarray):
        value = value.flat[0] if value.size == 1 else None
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")
    return text.partition("\0")[0].strip()[:_TEXT_CHARACTERS_MAX]


if __name__ == "__main__":
    rehearse()
    limit_process()
    answer(os.fdopen(0, "rb"), sys.stdout.buffer)
