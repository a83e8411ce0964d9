"""session.jsonl: what was typed and when it came into effect, as it happens."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from ergon.common.regular import read_bounded

VERSION = 1
MAX_BYTES = 1 << 30  # an hour of lines takes some hundred kilobytes


class JournalError(Exception):
    """A journal cannot be written, or what is to be read is none: one sentence."""


class Journal:
    """A journal that is being written; what was told survives whatever ends the program."""

    def __init__(self, path: Path) -> None:
        """Begin one where no file may be. Raises JournalError."""
        try:
            self._file: IO[str] = path.open("x", encoding="utf-8")
        except OSError as error:
            raise JournalError(f"{path}: {error.strerror}") from None
        self.path = path
        self._trouble = ""

    def tell(self, event: str, **fields: Any) -> None:
        """Append an event; where that fails the music goes on, and `trouble` says so once."""
        line = json.dumps({"v": VERSION, "event": event, **fields}, ensure_ascii=True)
        try:
            self._file.write(line + "\n")
            self._file.flush()
        except (OSError, ValueError) as error:
            self._trouble = f"the journal cannot be written: {error}"

    def trouble(self) -> str:
        """What kept it from being written since the last call, if anything."""
        trouble, self._trouble = self._trouble, ""
        return trouble

    def close(self) -> None:
        """End it, on the disk."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._trouble = f"the journal cannot be written: {error}"
        finally:
            self._file.close()


@dataclass(frozen=True, slots=True)
class Event:
    """One line of a journal: its number in the file, what it is, its fields."""

    number: int
    name: str
    fields: Mapping[str, Any]

    def get(self, name: str, kind: type, default: Any = None) -> Any:
        """A field of a kind. Raises JournalError where it is another, or missing."""
        value = self.fields.get(name, default)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if isinstance(value, float) and not math.isfinite(value):
            raise JournalError(f"line {self.number}: {name} is no number")
        if not isinstance(value, kind) and not (default is None and name not in self.fields):
            raise JournalError(f"line {self.number}: {name} is not what a journal says there")
        if value is None and kind is not type(None):
            raise JournalError(f"line {self.number}: {name} is missing")
        return value


def read(path: Path) -> Iterator[Event]:
    """Events of a journal; a last line that was cut off is left out. Raises JournalError."""
    try:
        data = read_bounded(path, MAX_BYTES)
        if len(data) > MAX_BYTES:
            raise JournalError(f"{path} is larger than any session's journal")
        text = data.decode().replace("\r\n", "\n")
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise JournalError(f"{path}: {why}") from None
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            fields = json.loads(line)
        except (ValueError, RecursionError):
            if number == len(lines):  # no line end: it was being written
                return
            raise JournalError(f"{path}, line {number}: this is no journal of a session") from None
        if not isinstance(fields, dict) or fields.get("v") != VERSION:
            raise JournalError(f"{path}, line {number}: this is no journal of a session")
        yield Event(number, str(fields.get("event", "")), fields)


def free(path: Path) -> Path:
    """`path`, or the first of `name-2`, `name-3` … that is not there."""
    found, count = path, 1
    while found.exists():
        count += 1
        found = path.with_stem(f"{path.stem}-{count}")
    return found
