"""Independent computations spread over processes, a few of them under way at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")


def results_as_completed(
    items: Iterable[K],
    submit: Callable[[K], Future[V]],
    wait: Callable[[Sequence[Future[V]]], None],
    result_of: Callable[[Future[V]], V],
    limit: int,
) -> Iterator[tuple[K, V]]:
    """Each item with its result, in order of completion.

    `submit` begins one, `wait` returns when one of some has ended; at most `limit` are under way.
    """
    remaining_items = iter(items)
    running: dict[Future[V], K] = {}
    while True:
        while len(running) < limit and (item := next(remaining_items, None)) is not None:
            running[submit(item)] = item
        if not running:
            return
        wait(list(running))
        for future in [item for item in running if item.done()]:
            yield running.pop(future), result_of(future)
