"""session.jsonl: every typed line and when it took effect, written as it happens.

Each event is passed to the operating system at once, so that it survives the end of the program.
A thread then syncs it to the disk, which takes some milliseconds, or on a busy disk some
hundred; a power failure loses the events of that time. What a full disk does not take waits in
memory and is written when there is room again. Events are numbered, so that a reader sees what is
missing.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NoReturn

from ergon.common.errors import ErgonError
from ergon.common.regular import NotRegularError, open_regular
from ergon.common.structured import MalformedTextError, parse_json

JOURNAL_VERSION = 1
MAX_BYTES = 1 << 28  # an hour of lines takes some hundred kilobytes
MAX_LINE = 1 << 25  # bytes; a score and all files that it uses are one line
# Bounds of what a journal may say: more frames than a session has at any rate, and beats.
FRAME_MAX = 1 << 40
BEAT_MAX = 1e7
_INSTANT_MAX = 1e12  # no number of a journal is larger
_WAITING_MAX = 1 << 26  # bytes that wait for room on the disk: more lines than a long evening has
_RETRY_SECONDS = 1.0  # [s] between attempts to write what waits


class JournalError(ErgonError):
    """A journal cannot be written or read: one sentence says why."""


class Journal:
    """A journal that is being written; its events survive however the program ends."""

    def __init__(self, path: Path) -> None:
        """Begin a journal in a new file. Raises JournalError."""
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise JournalError(f"{path}: {error.strerror}") from error
        self.path = path
        self._n_events = 0
        self._unwritten = bytearray()  # bytes that are not written yet
        self._failure_text = self._failure_reason = ""  # not reported yet; why writing fails now
        self._has_lost_events = False  # an event is in no file, or the disk may lack it
        self._wake_event = threading.Event()
        self._write_lock = threading.Lock()  # lines of two threads do not mix
        self._is_closed = False
        self._thread = threading.Thread(target=self._sync, name="ergon journal", daemon=True)
        self._thread.start()

    @property
    def has_failed(self) -> bool:
        """Whether something of it is not written."""
        return self._has_lost_events or bool(self._failure_reason)

    @property
    def is_full(self) -> bool:
        """Whether the buffer of unwritten events is full, so that further events are lost."""
        return len(self._unwritten) >= _WAITING_MAX

    @classmethod
    def begin(cls, path: Path) -> Journal:
        """Begin a journal under the first free name of `name`, `name-2`, … Raises JournalError.

        Several journals that begin at the same time get different names.
        """
        for candidate in numbered_paths(path):
            try:
                return cls(candidate)
            except JournalError as error:
                if not isinstance(error.__cause__, FileExistsError):
                    raise
        raise AssertionError  # the sequence of names is endless

    def append(self, event_name: str, **event_fields: Any) -> None:
        """Append an event, or keep it until it can be written; `pop_failure` reports a failure."""
        with self._write_lock:
            if self._file.closed:  # the second half of a panic may come after the end
                return
            self._n_events += 1
            event_head = {"v": JOURNAL_VERSION, "n": self._n_events, "event": event_name}
            json_line = (
                json.dumps({**event_head, **event_fields}, ensure_ascii=True).encode() + b"\n"
            )
            if len(json_line) > MAX_LINE or self.is_full:
                reason = (
                    "is too long for it" if len(json_line) > MAX_LINE else "found no room in memory"
                )
                self._failure_text = (
                    f"the journal lacks an event that {reason}: '{event_name}', "
                    f"{len(json_line):,} bytes"
                )
                self._has_lost_events = True
                return
            self._unwritten += json_line
            self._write()
        self._wake_event.set()

    def _write(self) -> None:
        """Pass to the operating system what it takes of what waits."""
        try:
            while self._unwritten:
                del self._unwritten[: self._file.write(self._unwritten)]
        except OSError as error:
            failure_reason = error.strerror or str(error)
            if failure_reason != self._failure_reason:
                self._failure_text = (
                    f"the journal cannot be written: {failure_reason}; what is typed is kept in "
                    "memory until it can be"
                )
            self._failure_reason = failure_reason
            return
        if self._failure_reason:
            loss_text = "" if self._has_lost_events else ", and lacks nothing"
            self._failure_text = f"the journal is written again{loss_text}"
            self._failure_reason = ""

    def pop_failure(self) -> str:
        """Why writing has failed since the last call; empty where it has not."""
        failure, self._failure_text = self._failure_text, ""
        return failure

    def close(self) -> None:
        """End the journal, and bring it to the disk."""
        self._is_closed = True
        self._wake_event.set()
        self._thread.join()
        if self._unwritten:
            self._failure_text = (
                f"the journal ends before its time: {self._failure_reason}; the last "
                f"{self._unwritten.count(10):,} events are lost"
            )
        with contextlib.suppress(OSError):  # `pop_failure` has reported it
            self._file.close()

    def _sync(self) -> None:
        """Sync events to the disk, all that have come meanwhile in one go."""
        is_over = False
        while not is_over:
            self._wake_event.wait(_RETRY_SECONDS if self._unwritten else None)
            self._wake_event.clear()
            is_over = self._is_closed  # events before `close` are synced below
            with self._write_lock:
                self._write()
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                self._failure_text = f"the journal cannot be written: {error.strerror or error}"
                self._has_lost_events = True


@dataclass(frozen=True, slots=True)
class JournalEvent:
    """One line of a journal: its number in the file, the name of the event, its fields."""

    file: str
    number: int
    name: str
    fields: Mapping[str, Any]

    def refuse(self, sentence: str) -> NoReturn:
        """Raise JournalError with the file and number of this line."""
        raise JournalError(f"{self.file}, line {self.number}: {sentence}") from None

    def get(self, name: str, value_type: type, default: Any = None) -> Any:
        """A field of a type. Raises JournalError where it is missing or of another type."""
        field_value = self.fields.get(name, default)
        if field_value is None:
            self.refuse(f"the field '{name}' is missing")
        if value_type is float and type(field_value) is int and abs(field_value) <= _INSTANT_MAX:
            field_value = float(field_value)
        if type(field_value) is not value_type:
            self.refuse(f"the field '{name}' has the wrong type or value")
        if value_type is str and not _is_text(field_value):
            self.refuse(f"the field '{name}' is not valid Unicode text")
        return field_value

    def number_of(
        self,
        field_name: str,
        number_type: type,
        low_bound: float,
        high_bound: float,
        default: Any = None,
    ) -> Any:
        """A number within bounds. Raises JournalError."""
        field_value = self.get(field_name, number_type, default)
        if not low_bound <= field_value <= high_bound:  # also refuses NaN
            self.refuse(
                f"the field '{field_name}' is {str(field_value)[:20]}; it must be from "
                f"{low_bound:g} to {high_bound:g}"
            )
        return field_value

    def mapping(self, name: str, value_type: type, count_max: int = 10_000) -> dict[str, Any]:
        """Values of one type by name; empty where the field is missing. Raises JournalError."""
        values_by_name: dict[str, Any] = self.get(name, dict, {})
        is_valid = _is_text if value_type is str else _is_ratio
        if len(values_by_name) > count_max or not all(
            _is_text(value_name) and is_valid(value) for value_name, value in values_by_name.items()
        ):
            self.refuse(f"the field '{name}' has the wrong type or value")
        return {value_name: value_type(value) for value_name, value in values_by_name.items()}

    def name_set(self, field_name: str) -> frozenset[str]:
        """A set of names; empty where the field is missing. Raises JournalError."""
        name_list: list[Any] = self.get(field_name, list, [])
        if not all(map(_is_text, name_list)):
            self.refuse(f"the field '{field_name}' has the wrong type or value")
        return frozenset(name_list)


def _is_text(value: object) -> bool:
    try:
        return isinstance(value, str) and value.encode() is not None
    except UnicodeEncodeError:  # half of a surrogate pair
        return False


def _is_ratio(value: object) -> bool:
    return type(value) in (int, float) and 0 <= value <= _INSTANT_MAX  # type: ignore[operator]


def read_events(path: Path) -> Iterator[JournalEvent]:
    """Events of a journal; a last line that was cut off is left out. Raises JournalError."""
    try:
        with open_regular(path) as journal_file:
            if os.fstat(journal_file.fileno()).st_size > MAX_BYTES:
                raise JournalError(f"{path} is larger than the journal of a session can be")
            yield from _journal_events(path, journal_file)
    except NotRegularError:
        raise JournalError(f"{path} is not a regular file, so it cannot be a journal") from None
    except OSError as error:
        raise JournalError(f"{path}: {error.strerror or error}") from None


def _journal_events(path: Path, journal_file: IO[bytes]) -> Iterator[JournalEvent]:
    bytes_left = MAX_BYTES
    for line_number in itertools.count(1):
        json_line = journal_file.readline(MAX_LINE)
        bytes_left -= len(json_line)
        if not json_line or bytes_left < 0:
            return
        if not json_line.strip():
            continue
        try:
            event_fields = parse_json(json_line)
        except MalformedTextError:
            if (
                not json_line.endswith(b"\n") and len(json_line) < MAX_LINE
            ):  # the program ended while it was written
                return
            event_fields = None
        if not isinstance(event_fields, dict) or event_fields.get("v") != JOURNAL_VERSION:
            raise JournalError(f"{path}, line {line_number}: this is not a session's journal")
        event_name = event_fields.get("event")
        yield JournalEvent(
            str(path), line_number, event_name if isinstance(event_name, str) else "", event_fields
        )


def numbered_paths(path: Path) -> Iterator[Path]:
    """`name`, `name-2`, `name-3` …"""
    yield path
    for path_number in itertools.count(2):
        yield path.with_stem(f"{path.stem}-{path_number}")


def free_path(path: Path) -> Path:
    """The first name of `name`, `name-2`, … under which no file exists now."""
    return next(candidate for candidate in numbered_paths(path) if not os.path.lexists(candidate))
