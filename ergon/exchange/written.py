"""The register of what ergon wrote: a hash of the content of each file, in the user's state folder.

A file whose hash is in the register is byte for byte as ergon wrote it, so what it holds can be
computed again. The register is kept beside the files and not in them: so it is the same for every
format, and no byte of an output depends on it. It knows contents, not names: a file that is moved
or copied is still known, and one that is edited is not.

Of a WAVE file, the samples are hashed by themselves, as its writer has done: SHA-256 of what is
before them, their own SHA-256 in hex digits, and what is after them.

STATE/written      SHA-256 in 64 hex digits a line, the newest last
STATE/written.old  what `written` was when it was full
"""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import time
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

from ergon.common.private import make_private_folder
from ergon.common.regular import open_regular, read_bounded
from ergon.common.user_folders import state_folder

from .temporary import has_path, try_lock
from .wave_header import NotWaveError, parse

_BLOCK_BYTES = 1 << 20  # bytes that are read at once
# Largest register [bytes]: 131,072 files, some hours of a sweep that writes its table every second.
_REGISTER_BYTES_MAX = 65 << 17
_REGISTER_NAME, _OLD_REGISTER_NAME = "written", "written.old"
_CLOCK_STEP_NANOSECONDS = 2_000_000_000  # [ns]: two changes may have one time, on FAT for 2 s
_APPEND_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NONBLOCK", 0)
# What this process wrote is known to it even where no register can be kept.
_hashes_written_here: set[str] = set()


def digest(hashed_file: BinaryIO, samples_hash: str | None = None) -> str:
    """The hash of a whole file, 64 hex digits. `samples_hash`, the hash of the samples of a WAVE
    file, is computed only if it is None.
    """
    try:
        hashed_file.seek(0)
        info = parse(hashed_file)
    except NotWaveError:
        return _plain_digest(hashed_file)
    n_bytes = info.n_frames * info.format.frame_bytes
    hash_state = hashlib.sha256()
    hashed_file.seek(0)
    _hash_next_bytes(hash_state, hashed_file, info.samples_offset)
    if samples_hash is None:
        samples_hash_state = hashlib.sha256()
        _hash_next_bytes(samples_hash_state, hashed_file, n_bytes)
        samples_hash = samples_hash_state.hexdigest()
    hash_state.update(samples_hash.encode())
    hashed_file.seek(info.samples_offset + n_bytes)
    _hash_next_bytes(hash_state, hashed_file)
    return hash_state.hexdigest()


def _plain_digest(hashed_file: BinaryIO) -> str:
    """The hash of all bytes of a file."""
    hashed_file.seek(0)
    hash_state = hashlib.sha256()
    _hash_next_bytes(hash_state, hashed_file)
    return hash_state.hexdigest()


def _hash_next_bytes(hash_state: hashlib._Hash, file: BinaryIO, n_bytes: float = math.inf) -> None:
    """Hash the next bytes of a file, at most `n_bytes` or all."""
    while block := file.read(int(min(n_bytes, _BLOCK_BYTES))):
        hash_state.update(block)
        n_bytes -= len(block)


def remember(file_hash: str) -> None:
    """Note the hash of a file that is about to get its name. Where no register can be kept, only
    this process knows it.
    """
    _hashes_written_here.add(file_hash)
    folder = state_folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        make_private_folder(folder)
        _make_room(folder)
        handle = os.open(folder / _REGISTER_NAME, _APPEND_FLAGS, 0o600)
        try:
            os.write(handle, f"{file_hash}\n".encode())
        finally:
            os.close(handle)


def is_known(path: Path) -> bool:
    """Whether a file is as ergon wrote it for this user, on this machine."""
    try:
        with open_regular(path) as written_file:
            stat = os.fstat(written_file.fileno())
            if abs(time.time_ns() - stat.st_mtime_ns) < _CLOCK_STEP_NANOSECONDS:
                file_hash = digest(written_file)
            else:
                file_hash = _digest_of(
                    path, stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns
                )
    except OSError:
        return False
    if file_hash in _hashes_written_here:
        return True
    folder = state_folder()
    register_paths = (
        () if folder is None else (folder / _REGISTER_NAME, folder / _OLD_REGISTER_NAME)
    )
    registers = [_register_content(name) for name in register_paths]
    if any(file_hash.encode() in register for register in registers):
        return True
    # An earlier version hashed WAVE files as all others.
    with contextlib.suppress(OSError), open_regular(path) as written_file:
        file_hash = _plain_digest(written_file)
    return any(file_hash.encode() in register for register in registers)


@lru_cache(maxsize=64)
def _digest_of(path: Path, *_: int) -> str:
    """The hash of a file; a command asks for it before its work and again after it."""
    with open_regular(path) as file:
        return digest(file)


def _register_content(path: Path) -> bytes:
    try:
        return read_bounded(path, 2 * _REGISTER_BYTES_MAX)
    except OSError:
        return b""


def _make_room(folder: Path) -> None:
    """Begin another register when this one is full; one process does it, the others go on."""
    path = folder / _REGISTER_NAME
    if not path.exists() or path.stat().st_size < _REGISTER_BYTES_MAX:
        return
    with path.open("rb+") as file:
        if try_lock(file.fileno()) and has_path(file.fileno(), path):
            os.replace(path, folder / _OLD_REGISTER_NAME)
