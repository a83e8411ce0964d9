"""A Dask cluster of processes of this machine that no other user of it can use.

Dask runs what it is sent, and any user may connect to a port of this machine. So scheduler, workers
and their nannies speak TLS alone, with a certificate that is made for this cluster and kept in
memory; a connection without its key is refused. Dask's HTTP pages would need no certificate, so
they are not served.
"""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator
from typing import Any

import dask
import distributed

from ergon.common.private import runtime_folder

_HOST = "127.0.0.1"


class UnservedScheduler(distributed.Scheduler):
    """A scheduler without pages."""

    def start_http_server(self, *_arguments: Any, **_options: Any) -> None:
        """Serve no pages."""


class UnservedWorker(distributed.Worker):
    """A worker without pages."""

    def start_http_server(self, *_arguments: Any, **_options: Any) -> None:
        """Serve no pages."""


@contextlib.contextmanager
def local_cluster(count: int, allowed_failures: int) -> Iterator[Any]:
    """A cluster of `count` processes, which end with this context. A task is given up after it has
    ended several of them.

    Raises ImportError without `cryptography`, NotPrivateError, and OSError or RuntimeError if a
    process ends while it starts.
    """
    security = distributed.Security.temporary()  # type: ignore[no-untyped-call]
    common_options = {"host": _HOST, "protocol": "tls", "security": security}
    worker = {
        **common_options,
        "nthreads": 1,
        "worker_class": UnservedWorker,
        "memory_limit": 1.0 / count,
        "silence_logs": logging.CRITICAL,
    }
    settings = {
        "distributed.scheduler.allowed-failures": allowed_failures,
        # Dask's folder in /tmp is one for all users. What a killed worker leaves, Dask removes.
        "temporary-directory": str(runtime_folder({}) / "workers"),
    }
    with dask.config.set(settings):
        with warnings.catch_warnings(action="ignore"):
            cluster = distributed.SpecCluster(  # type: ignore[no-untyped-call]
                scheduler={
                    "cls": UnservedScheduler,
                    "options": {**common_options, "dashboard": False},
                },
                workers={
                    worker_index: {"cls": distributed.Nanny, "options": worker}
                    for worker_index in range(count)
                },
                security=security,
                silence_logs=logging.CRITICAL,
            )
        with cluster:
            yield cluster
