"""Packs: a score and all files that it reads, as one file.

    piece.ergonpack     a ZIP file without compression
      ergonpack.json      format, version of ergon, the score; size and SHA-256 of each file
      files/…             the files, in their places relative to each other

The same files give the same bytes: names are sorted, times are fixed, and nothing is compressed,
because compressors differ between machines. A pack may come from anybody. It is read whole and
within bounds, and every name and hash is checked before the first file is written.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import stat
import struct
import unicodedata
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ergon.common.errors import ErgonError
from ergon.common.regular import read_bounded
from ergon.common.structured import MalformedTextError, parse_json
from ergon.common.terminal import printable

SUFFIX = ".ergonpack"
FORMAT = 1
BYTES_MAX = 256_000_000  # largest pack: hours of takes
FILES_MAX = 1024
_NAME_MAX = 200  # bytes of a name with its folders
_MANIFEST = "ergonpack.json"
_FILES = "files/"
_MANIFEST_BYTES_MAX = 1 << 20
_ENTRY_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest that ZIP has
_END_RECORD = struct.Struct("<4s4H2LH")  # end of central directory record (APPNOTE 6.3.10, 4.3.16)
_END_SIGNATURE, _ZIP64_SIGNATURE, _ZIP64_BYTES = b"PK\5\6", b"PK\6\7", 20
_RECORD_BYTES_MAX = 46 + len(_FILES) + _NAME_MAX + 64  # of a file in the central directory
# Windows refuses these characters, or takes them for parts of a path; it keeps the names of devices
# for itself, with any ending.
_FORBIDDEN_PATTERN = re.compile(r'[\\:*?"<>|]')
_DEVICE_NAME_PATTERN = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_HASH_PATTERN = re.compile(r"[0-9a-f]{64}")


class PackError(ErgonError):
    """A pack that cannot be read, or files that cannot be packed; the message says why."""


@dataclass(frozen=True, slots=True)
class Pack:
    """The files by name, which of them is the score, and the version of ergon that packed them."""

    score: str
    version: str
    files: Mapping[str, bytes]


def pack_bytes(pack: Pack) -> bytes:
    """The bytes of a pack. Raises PackError if it has more than a pack may have."""
    _check_names(pack.files)
    manifest = {
        "format": FORMAT,
        "ergon": pack.version,
        "score": pack.score,
        "files": {
            name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in sorted(pack.files.items())
        },
    }
    text = json.dumps(manifest, indent=1, ensure_ascii=False).encode()
    archive_entries = [(_MANIFEST, text)]
    archive_entries += [(_FILES + name, data) for name, data in sorted(pack.files.items())]
    if (
        sum(len(data) for _, data in archive_entries) + _RECORD_BYTES_MAX * 2 * len(archive_entries)
        > BYTES_MAX
    ):
        raise PackError(
            f"the score and its files have more than {BYTES_MAX // 1_000_000} MB, the most that a "
            "pack may have; cut its takes (`ergon take trim`)"
        )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, entry_data in archive_entries:
            zip_entry = zipfile.ZipInfo(name, _ENTRY_TIME)
            zip_entry.create_system = 3  # Unix, on every machine
            zip_entry.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(zip_entry, entry_data)
    return stream.getvalue()


def read_pack(path: Path) -> Pack:
    """A pack, with every name and hash checked. Raises PackError and OSError."""
    data = read_bounded(path, BYTES_MAX)
    try:
        return _parsed_pack(data)
    except PackError as error:
        raise PackError(f"{path}: {error}") from None
    except (MalformedTextError, zipfile.BadZipFile) as error:
        raise PackError(f"{path}: the pack is damaged: {printable(str(error))}") from None
    except (ValueError, IndexError, KeyError, EOFError, OSError, RuntimeError, struct.error):
        # What `zipfile` raises of offsets, versions and encodings that no pack has.
        raise PackError(f"{path}: the pack is damaged: its list of files makes no sense") from None


def write_files(pack: Pack, folder: Path) -> Path:
    """Write the files of a pack into a new and empty folder; the path of the score in it."""
    for name, file_data in pack.files.items():
        path = folder.joinpath(*PurePosixPath(name).parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            file.write(file_data)
    return folder / pack.score


def _parsed_pack(pack_data: bytes) -> Pack:
    _check_end(pack_data)
    with zipfile.ZipFile(io.BytesIO(pack_data)) as archive:
        archive_entries = archive.infolist()
        for archive_entry in archive_entries:
            _check_entry(archive_entry)
        if sum(entry.file_size for entry in archive_entries) > len(pack_data):
            raise PackError("the pack is damaged: its files have more bytes than the pack")
        content_by_name = {}
        for archive_entry in archive_entries:
            if archive_entry.filename in content_by_name:
                raise PackError(f"the pack has two files {_quoted_name(archive_entry.filename)}")
            content_by_name[archive_entry.filename] = archive.read(archive_entry)
    manifest = content_by_name.pop(_MANIFEST, None)
    if manifest is None:
        raise PackError(f"the pack has no {_MANIFEST}, so `ergon pack` did not make it")
    if len(manifest) > _MANIFEST_BYTES_MAX:
        raise PackError(f"{_MANIFEST} has more than {_MANIFEST_BYTES_MAX >> 20} MB")
    files_by_name = {}
    for entry_name, file_bytes in content_by_name.items():
        if not entry_name.startswith(_FILES):
            raise PackError(
                f"{_quoted_name(entry_name)} is no file of a pack, which are in {_FILES}"
            )
        files_by_name[entry_name.removeprefix(_FILES)] = file_bytes
    _check_names(files_by_name)
    return _with_manifest(parse_json(manifest), files_by_name)


def _check_end(pack_data: bytes) -> None:
    """Check the last record of the pack, so that no long list of files is read."""
    if len(pack_data) > BYTES_MAX:
        raise PackError(f"a pack has {BYTES_MAX // 1_000_000} MB at most, and this has more")
    if pack_data[:4] != b"PK\3\4":
        raise PackError("the file is not a pack; `ergon pack SCORE` makes one")
    signature, *_, entry_count, directory_size, _, comment_length = (
        _END_RECORD.unpack(pack_data[-_END_RECORD.size :])
        if len(pack_data) >= _END_RECORD.size
        else (b"", 0, 0, 0, 0)
    )
    locator_start = len(pack_data) - _END_RECORD.size - _ZIP64_BYTES
    if signature != _END_SIGNATURE or comment_length:
        raise PackError("the pack is cut short, or something was added to its end")
    if pack_data[max(locator_start, 0) :][:4] == _ZIP64_SIGNATURE or entry_count > FILES_MAX + 1:
        raise PackError(f"a pack has {FILES_MAX:,} files at most, and this has more")
    if directory_size > entry_count * _RECORD_BYTES_MAX:
        raise PackError("the pack is damaged: its list of files is too long for their number")


def _check_entry(zip_entry: zipfile.ZipInfo) -> None:
    entry_name = _quoted_name(zip_entry.orig_filename)
    kind = stat.S_IFMT(zip_entry.external_attr >> 16)
    if zip_entry.is_dir() or kind not in (0, stat.S_IFREG):
        raise PackError(f"{entry_name} is a link or a folder; a pack has only files")
    if zip_entry.flag_bits & 1:
        raise PackError(f"{entry_name} is encrypted; a pack has only plain files")
    if (
        zip_entry.compress_type != zipfile.ZIP_STORED
        or zip_entry.compress_size != zip_entry.file_size
    ):
        raise PackError(f"{entry_name} is compressed; a pack has only plain files")
    if zip_entry.orig_filename != zip_entry.filename:
        raise PackError(f"{entry_name} has a character that the name of a file may not have")


def _check_names(file_names: Iterable[str]) -> None:
    """Raise PackError unless all names are plain, and different on every system."""
    file_names = list(file_names)
    if len(file_names) > FILES_MAX:
        raise PackError(
            f"a pack has {FILES_MAX:,} files at most, and these are {len(file_names):,}"
        )
    name_by_key: dict[str, str] = {}
    for file_name in file_names:
        _check_name(file_name)
        name_key = _portable_key(file_name)
        if name_key in name_by_key:
            both_names = f"{_quoted_name(name_by_key[name_key])} and {_quoted_name(file_name)}"
            raise PackError(f"{both_names} are one file on some systems; rename one")
        name_by_key[name_key] = file_name
    for file_name in file_names:
        for folder in map(_portable_key, map(str, PurePosixPath(file_name).parents)):
            if folder in name_by_key:
                raise PackError(f"{_quoted_name(name_by_key[folder])} is a file and a folder")


def _portable_key(name: str) -> str:
    """What names have in common that are the same file on some system."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _check_name(file_name: str) -> None:
    quoted_name = _quoted_name(file_name)
    path_parts = file_name.split("/")
    if file_name.startswith("/") or ".." in path_parts or re.match(r"[A-Za-z]:", file_name):
        raise PackError(f"{quoted_name} leads out of the pack; all files lie in one folder")
    try:
        is_long = len(file_name.encode()) > _NAME_MAX
    except UnicodeEncodeError:
        raise PackError(f"{quoted_name} is not a name in UTF-8; rename the file") from None
    if is_long:
        raise PackError(f"{quoted_name}: a name in a pack has {_NAME_MAX} bytes at most")
    if not file_name.isprintable() or _FORBIDDEN_PATTERN.search(file_name):
        raise PackError(f"{quoted_name} has a character that not every system allows in a name")
    for path_part in path_parts:
        if not path_part or path_part.startswith((".", " ")) or path_part.endswith((".", " ")):
            raise PackError(
                f"{quoted_name}: files and folders in a pack begin and end with neither a dot nor "
                "a space"
            )
        if _DEVICE_NAME_PATTERN.fullmatch(path_part):
            raise PackError(f"{quoted_name}: some systems have a device of this name; rename it")


def _with_manifest(manifest: Any, packed_files: Mapping[str, bytes]) -> Pack:
    """The pack that the manifest describes. Raises PackError if its files are others."""
    if not isinstance(manifest, dict):
        raise PackError(f"{_MANIFEST} is not a table")
    if manifest.get("format") != FORMAT:
        raise PackError(
            f"the pack has format {printable(str(manifest.get('format')))[:40]}, and this ergon "
            f"reads format {FORMAT}; a newer ergon may read it"
        )
    version, score, listed_files = (manifest.get(key) for key in ("ergon", "score", "files"))
    if not isinstance(version, str) or not isinstance(listed_files, dict):
        raise PackError(f"{_MANIFEST} lacks the version of ergon or the list of files")
    if mismatched_names := sorted(listed_files.keys() ^ packed_files.keys()):
        kind = "is missing" if mismatched_names[0] in listed_files else f"is not in {_MANIFEST}"
        raise PackError(f"the pack is damaged: the file {_quoted_name(mismatched_names[0])} {kind}")
    if not isinstance(score, str) or score not in packed_files:
        raise PackError(f"{_MANIFEST} does not say which of its files is the score")
    for file_name, file_data in packed_files.items():
        listed_entry = listed_files[file_name] if isinstance(listed_files[file_name], dict) else {}
        digest = listed_entry.get("sha256")
        if not isinstance(digest, str) or not _HASH_PATTERN.fullmatch(digest):
            raise PackError(f"{_MANIFEST} has no SHA-256 of {_quoted_name(file_name)}")
        if digest != hashlib.sha256(file_data).hexdigest() or listed_entry.get("bytes") != len(
            file_data
        ):
            raise PackError(
                f"the pack is damaged: {_quoted_name(file_name)} is not the file that was packed "
                "(its SHA-256 differs)"
            )
    return Pack(score, version, packed_files)


def _quoted_name(name: str) -> str:
    return f"'{printable(name[:_NAME_MAX])}'"
