"""Independent computations spread over processes, a few of them under way at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def results_as_completed(
    items: Iterable[Item],
    submit: Callable[[Item], Future[Result]],
    wait: Callable[[Sequence[Future[Result]]], None],
    result_of: Callable[[Future[Result]], Result],
    running_max: int,
) -> Iterator[tuple[Item, Result]]:
    """Each item with its result, in order of completion.

    `submit` begins one, `wait` returns when one of some has ended; at most `running_max` are under
    way.
    """
    remaining_items = iter(items)
    item_by_future: dict[Future[Result], Item] = {}
    while True:
        while (
            len(item_by_future) < running_max and (item := next(remaining_items, None)) is not None
        ):
            item_by_future[submit(item)] = item
        if not item_by_future:
            return
        wait(list(item_by_future))
        for future in [future for future in item_by_future if future.done()]:
            yield item_by_future.pop(future), result_of(future)
