"""Stretches of islands in the user's cache folder: their sound, and their state at the end.

A file is a head (magic, a checksum of all that follows), the number of samples, the samples as
f64, and the state; a file that is cut, changed or foreign counts as missing.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ergon import _core

from . import cache_folder
from .cache_folder import CacheFolder, versioned_key

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FILE_HEADER = struct.Struct("<8sQ")
_LENGTH_FORMAT = struct.Struct("<Q")
_MAGIC = b"ERGONST1"
_FILES_MAX = 20_000
_BYTES_MAX = 4_000_000_000  # all files: eleven minutes of 100 outputs at 44.1 kHz
_FILE_BYTES_MAX = 128_000_000


class Stretch(NamedTuple):
    """The sound of an island (n_frames · n_out,) [m or N], and its state after it."""

    sound: NDArray[np.float64]
    state: bytes


class StretchStore:
    """Stretches by the hash of everything that they depend on."""

    def __init__(self, folder: Path, n_bytes_max: int = _BYTES_MAX) -> None:
        """Use a folder, which need not exist; its files are bounded in bytes."""
        self._folder = CacheFolder(folder, ".stretch", _FILES_MAX, n_bytes_max, _FILE_BYTES_MAX)

    def get(self, key: str) -> Stretch | None:
        """The stretch stored under a key; None if there is none."""
        import numpy as np

        stored_data = self._folder.read(versioned_key(key))
        if stored_data is None or len(stored_data) < _FILE_HEADER.size + _LENGTH_FORMAT.size:
            return None
        magic, checksum = _FILE_HEADER.unpack_from(stored_data)
        checked_bytes = stored_data[_FILE_HEADER.size :]
        if magic != _MAGIC or checksum != _core.crc32(np.frombuffer(checked_bytes, np.uint8)):
            return None
        (n_samples,) = _LENGTH_FORMAT.unpack_from(checked_bytes)
        sound_stop = _LENGTH_FORMAT.size + 8 * n_samples
        if sound_stop > len(checked_bytes):
            return None
        sound = np.frombuffer(checked_bytes[_LENGTH_FORMAT.size : sound_stop], dtype="<f8")
        return Stretch(sound.astype(np.float64, copy=False), bytes(checked_bytes[sound_stop:]))

    def has(self, key: str) -> bool:
        """Whether there is a stretch under a key, which may still be damaged."""
        return self._folder.has(versioned_key(key))

    def put(
        self, key: str, sound: NDArray[np.float64] | Sequence[NDArray[np.float64]], state: bytes
    ) -> bool:
        """Store the sound (n_frames · n_out,), or pieces of it of any shape, and the state after
        it; True if they were stored.
        """
        import numpy as np

        pieces = [sound] if isinstance(sound, np.ndarray) else sound
        samples = [np.ascontiguousarray(piece, dtype="<f8").data for piece in pieces]
        n_samples = sum(piece.size for piece in pieces)
        stored_parts: list[bytes | memoryview] = [_LENGTH_FORMAT.pack(n_samples), *samples, state]
        checksum = 0
        for part in stored_parts:
            checksum = _core.crc32(np.frombuffer(part, np.uint8), checksum)
        return self._folder.write(
            versioned_key(key), _FILE_HEADER.pack(_MAGIC, checksum), *stored_parts
        )

    def remove_oldest(self) -> None:
        """Remove the stretches that were used least recently, until the rest is within bounds."""
        self._folder.remove_oldest()


def user_store(environment: Mapping[str, str] = os.environ) -> StretchStore | None:
    """The user's own store of stretches; None if nothing is to be kept."""
    folder = cache_folder.user_folder("stretches", environment)
    return None if folder is None else StretchStore(folder)
