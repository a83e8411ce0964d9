"""Reads lines of a file, a pipe or a terminal while a line is computed, so that a stop acts at
once.
"""

from __future__ import annotations

import codecs
import io
import os
import select
import stat
import sys
import threading
from typing import TextIO

from ergon.repl.line_queue import LineQueue

from .output import F12_SEQUENCE, valid_unicode

_CHUNK_BYTES = 1 << 16  # bytes


class LineReader:
    """A thread that reads lines and enters them into a queue.

    From a regular file it reads only one line ahead; from a pipe or a terminal, everything that
    comes.
    """

    def __init__(self, source: TextIO, queue: LineQueue[None]) -> None:
        """Read an open text file, from which nothing else may read."""
        self._queue = queue
        self._fd = source.fileno()
        decoder = codecs.getincrementaldecoder(source.encoding or "utf-8")("replace")
        self._decoder = io.IncrementalNewlineDecoder(decoder, translate=True)
        is_file = stat.S_ISREG(os.fstat(self._fd).st_mode)
        self._line_permits = threading.Semaphore(1) if is_file else None
        self._unfinished_line = ""  # the unfinished line
        self._is_stopped = False
        self._wake_read, self._wake_write = os.pipe() if sys.platform != "win32" else (-1, -1)
        self._thread = threading.Thread(target=self._read, name="ergon-input", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def note_line_taken(self) -> None:
        """Note that a line was taken from the queue."""
        if self._line_permits is not None:
            self._line_permits.release()

    def drop_typed(self) -> None:
        """Drop a line that is typed and not yet entered."""
        self._unfinished_line = ""

    def stop(self) -> None:
        """Stop reading."""
        self._is_stopped = True
        self.note_line_taken()
        if self._wake_write >= 0:
            os.write(self._wake_write, b"x")
            self._thread.join()
            os.close(self._wake_read)
            os.close(self._wake_write)

    def _read(self) -> None:
        try:
            while data := self._read_bytes():
                self._add_text(self._decoder.decode(data))
            self._add_text(self._decoder.decode(b"", final=True))
        except OSError:  # a closed terminal is the end of input
            pass
        if self._unfinished_line:
            self._enter(self._unfinished_line)
        if self._wait_for_permit():
            self._queue.end()

    def _read_bytes(self) -> bytes:
        """The next bytes, for which it waits; empty at the end."""
        if self._wake_read >= 0:
            ready, _, _ = select.select([self._fd, self._wake_read], [], [])
            if self._wake_read in ready:
                return b""
        return os.read(self._fd, _CHUNK_BYTES)

    def _add_text(self, text: str) -> None:
        *lines, unfinished_line = (self._unfinished_line + text).split("\n")
        self._unfinished_line = (
            unfinished_line if self._line_permits else self._act_on_panic_key(unfinished_line)
        )
        for line in lines:
            self._enter(line)

    def _enter(self, line: str) -> None:
        if self._wait_for_permit():
            self._queue.enter(valid_unicode(self._act_on_panic_key(line)), None)

    def _wait_for_permit(self) -> bool:
        """Wait until another line may be entered; False after `stop`."""
        if self._line_permits is not None:
            self._line_permits.acquire()
        return not self._is_stopped

    def _act_on_panic_key(self, typed_text: str) -> str:
        """Remove F12 from a text, and act on it as a panic."""
        if F12_SEQUENCE not in typed_text:
            return typed_text
        self._queue.panic()
        return typed_text.replace(F12_SEQUENCE, "")
