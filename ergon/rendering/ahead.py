"""A generator whose items a thread computes ahead of the consumer, in the same order."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterator
from typing import TypeVar

from ergon._core import Work

T = TypeVar("T")
_QUEUE_BLOCKS = 4  # blocks that may wait: enough to even out the two, little memory
_POLL_SECONDS = 0.1  # [s] between checks whether the consumer is gone


def computed_ahead(item_source: Iterator[T]) -> Generator[T, None, None]:
    """The items of `item_source`, computed in a thread of their own up to four items ahead.

    An exception in the source is raised here. When the consumer stops early, so does the thread.
    """
    # An entry is a list with one item, an empty list at the end, or the exception that ended the
    # source.
    block_queue: queue.Queue[list[T] | BaseException] = queue.Queue(_QUEUE_BLOCKS)
    has_ended = threading.Event()
    ahead_work = Work()

    def put(entry: list[T] | BaseException) -> bool:
        while not has_ended.is_set():
            try:
                block_queue.put(entry, timeout=_POLL_SECONDS)
                return True
            except queue.Full:
                continue
        return False

    def work() -> None:
        try:
            with ahead_work:
                for item in item_source:
                    if not put([item]):
                        return
            put([])
        except BaseException as error:  # PyO3's panic exception is no Exception
            put(error)

    thread = threading.Thread(target=work, name="ergon-simulation", daemon=True)
    thread.start()
    try:
        while queued_entry := block_queue.get():
            if isinstance(queued_entry, BaseException):
                raise queued_entry
            yield from queued_entry
    finally:
        has_ended.set()
        ahead_work.cancel()  # a block may take minutes
        thread.join()
