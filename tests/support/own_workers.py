"""A cluster as ergon sees it, made of threads of this process: calls wait in one queue, as in
Dask.
"""

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import pytest

from ergon.api import cluster
from ergon.common.report import Report


class Client:
    """A Dask client, with the methods that are used. `called` lists functions and their
    arguments.
    """

    status = "running"

    def __init__(self, count: int) -> None:
        self.count = count
        self.called: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        self.pool = ThreadPoolExecutor(count)

    def submit(self, function: Callable[[Any], Any], value: Any, pure: bool) -> Any:
        return function(value)

    def get_executor(self, **_: Any) -> Executor:
        built = self

        class Pool(Executor):
            def submit(self, function: Any, /, *words: Any, **named: Any) -> Future[Any]:
                built.called.append((function, words))
                return built.pool.submit(function, *words)

        return Pool()

    def scheduler_info(self, n_workers: int) -> dict[str, dict[int, None]]:
        return {"workers": dict.fromkeys(range(self.count))}


def use(monkeypatch: pytest.MonkeyPatch, count: int = 2) -> Client:
    """Every client opened from now on is this one."""
    client = Client(count)

    @contextlib.contextmanager
    def opened(on: str, report: Report) -> Iterator[cluster.Cluster]:
        single = cluster.Cluster(client, count, on)
        yield single
        single.report_shares(report)

    monkeypatch.setattr(cluster, "open_cluster", opened)
    return client
