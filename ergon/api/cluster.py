"""Processes that share the work of renders and sweeps, by Dask: of this machine, or of many."""

from __future__ import annotations

import concurrent.futures as cf
import contextlib
import hashlib
import importlib
import logging
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from ergon import _core
from ergon.common.extras import install_command
from ergon.common.private import NotPrivateError
from ergon.common.report import Report
from ergon.exchange import plan_file
from ergon.rendering.remote import Answer, ClusterError, Request

from . import cluster_worker
from .cluster_worker import Job
from .errors import OptionError
from .parallel_results import results_as_completed
from .plan import budget_of
from .score_bundle import bundle_score, digest

if TYPE_CHECKING:
    from ergon.scores.reading.load import Loaded
    from ergon.scores.staging.stage import Stage

Item = TypeVar("Item")
Result = TypeVar("Result")
_LOCAL_WORKERS_MAX = 1024
_TASK_RETRIES = 10  # attempts for a request whose worker died
_CONNECT_SECONDS_MAX = 20.0  # [s]
_POLL_SECONDS = 1.0  # [s] between looks at the connection
_START_ATTEMPTS = 5
_LOST_POLLS_MAX = 30  # looks without a scheduler or without workers, until that is an error
# Loggers of Dask and of the libraries below it.
_SILENCED_LOGGERS = ("asyncio", "distributed", "tornado")
_ADDRESS_PATTERN = re.compile(r"(tcp|tls|ucx|ws|wss)://[^\s/]+:\d+")


@dataclass(slots=True)
class _WorkerShare:
    """What a worker has computed: stretches, and the time that they took [s]."""

    n_stretches: int = 0
    seconds: float = 0.0


@dataclass(slots=True)
class Cluster:
    """A Dask client, and the number of its workers when it was opened; several threads may use
    it.
    """

    client: Any
    count: int
    on: str
    _shares_by_worker: dict[str, _WorkerShare] = field(default_factory=dict)
    _share_lock: threading.Lock = field(default_factory=threading.Lock)

    def executor(self) -> Executor:
        """An executor on the workers; a task is repeated if its worker dies."""
        executor: Executor = self.client.get_executor(retries=_TASK_RETRIES, pure=False)
        return executor

    def wait(self, futures: Sequence[Future[Any]]) -> None:
        """Return when one of the futures has ended. Raises ClusterError if no worker is left."""
        n_lost_polls = 0
        while not cf.wait(futures, _POLL_SECONDS, FIRST_COMPLETED).done:
            _core.poll()
            if self.client.status == "running" and self._n_workers():
                n_lost_polls = 0
                continue
            n_lost_polls += 1
            if self.client.status in ("closing", "closed") or n_lost_polls > _LOST_POLLS_MAX:
                raise self.lost_error()

    def compute_items(
        self, items: Iterable[Item], submit: Callable[[Executor, Item], Future[Result]]
    ) -> Iterator[tuple[Item, Result]]:
        """Each item with the result of the task that `submit` begins for it, in order of
        completion.
        """
        pool = self.executor()
        begin_task = partial(submit, pool)
        return results_as_completed(items, begin_task, self.wait, self.result, 2 * self.count)

    def result(self, future: Future[Any]) -> Any:
        """The result of a future that has ended. Raises ClusterError."""
        try:
            return future.result()
        except ClusterError:
            raise
        except CancelledError:
            raise self.lost_error() from None
        except ImportError as error:
            raise ClusterError(
                f"a worker lacks what it needs ({error}); install the same ergon there: "
                f"{install_command('cluster')}"
            ) from None
        except Exception as error:  # an exception of Dask, some of which are known by name alone
            if type(error).__name__ == "KilledWorker":
                raise ClusterError(
                    "a part of the work ended several workers, one after the other; they may lack "
                    "memory, and their logs say more"
                ) from None
            raise ClusterError(f"a worker failed: {type(error).__name__}: {error}") from None

    def lost_error(self) -> ClusterError:
        """The error for a scheduler, or all its workers, that do not answer."""
        problem_text = f"the scheduler at {self.on} does not answer"
        if self.client.status == "running":
            problem_text = f"the scheduler at {self.on} has no workers any more"
        return ClusterError(
            f"{problem_text}; what arrived is kept: the same command goes on from there"
        )

    def receive(self, answer: Answer) -> None:
        """Count what the worker has computed."""
        with self._share_lock:
            worker_total = self._shares_by_worker.setdefault(answer["worker"], _WorkerShare())
            worker_total.n_stretches += 1
            worker_total.seconds += answer["seconds"]

    def report_shares(self, report: Report) -> None:
        """Report a line for each worker that computed stretches."""
        total_seconds = sum(worker.seconds for worker in self._shares_by_worker.values())
        for worker_name, worker in sorted(self._shares_by_worker.items()):
            percent = 100.0 * worker.seconds / total_seconds if total_seconds else 0.0
            report.say(
                f"worker {worker_name}: {worker.n_stretches} stretches in {worker.seconds:.1f} s, "
                f"{percent:.0f} % of the work that was shared"
            )
            share_fields = {"stretches": worker.n_stretches, "seconds": worker.seconds}
            report.event("worker", worker=worker_name, **share_fields)

    def _n_workers(self) -> int:
        return len(self.client.scheduler_info(n_workers=-1)["workers"])


@dataclass(slots=True)
class SharedWorkers:
    """Workers that compute stretches of one piece; `rendering.remote.Workers`."""

    cluster: Cluster
    executor: Executor
    job: Any  # a future of the job, at the scheduler

    @property
    def count(self) -> int:
        """How many requests are computed at the same time."""
        return self.cluster.count

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request computed."""
        return self.executor.submit(cluster_worker.compute_stretch, self.job, request)

    def wait(self, futures: Sequence[Future[Answer]]) -> None:
        """Return when one of them has ended."""
        self.cluster.wait(futures)

    def answer(self, future: Future[Answer]) -> Answer:
        """The answer of one that has ended."""
        answer: Answer = self.cluster.result(future)
        return answer

    def receive(self, answer: Answer, n_frames: int) -> None:
        """Count what the worker has computed."""
        self.cluster.receive(answer)


def count_of(on: str, report: Report) -> int:
    """How many processes "local:N" or a scheduler has. Raises OptionError and ClusterError."""
    local_count = _local_count(on)
    if local_count is not None:
        return local_count
    with open_cluster(on, report) as cluster:
        return cluster.count


def _local_count(on: str) -> int | None:
    """N of "local:N"; None for an address. Raises OptionError."""
    local_match = re.fullmatch(r"local:(\d+)", on)
    if local_match is not None and not 1 <= int(local_match[1]) <= _LOCAL_WORKERS_MAX:
        raise OptionError(
            "on", f"local:{local_match[1]}: the number is from 1 to {_LOCAL_WORKERS_MAX}"
        )
    if local_match is None and not _ADDRESS_PATTERN.fullmatch(on):
        reason = f"'{on}' is neither local:N nor an address such as tcp://HOST:8786"
        raise OptionError("on", reason)
    return None if local_match is None else int(local_match[1])


@contextlib.contextmanager
def open_cluster(on: str, report: Report) -> Iterator[Cluster]:
    """The processes that "local:N" or the address of a scheduler mean.

    At the end `report` gets the amount of render work of each. Raises OptionError, ClusterError.
    """
    local_count = _local_count(on)
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise ClusterError(_missing_package_error("dask and distributed")) from None
    _silence_logs()
    with contextlib.ExitStack() as stack:
        address: Any = on
        if local_count is not None:
            address = _start_cluster(stack, local_count)
        try:
            security = _security(distributed, on) if on.startswith("tls:") else None
            client = stack.enter_context(
                distributed.Client(address, timeout=_CONNECT_SECONDS_MAX, security=security)
            )
            client.wait_for_workers(1, timeout=_CONNECT_SECONDS_MAX)
        except TimeoutError:
            raise ClusterError(
                f"{on}: no worker answers within {_CONNECT_SECONDS_MAX:g} s; `dask scheduler` and "
                "`dask worker ADDRESS` start what is missing"
            ) from None
        except (OSError, RuntimeError) as error:
            raise ClusterError(
                f"{on}: no scheduler answers ({error}); `dask scheduler` starts one"
            ) from None
        workers = client.scheduler_info(n_workers=-1)["workers"]
        cluster = Cluster(client, len(workers), on)
        try:
            yield cluster
        finally:
            cluster.report_shares(report)


def _security(distributed: Any, on: str) -> Any:
    """The certificates of Dask's configuration. Raises ClusterError if they are missing or
    invalid.
    """
    security = distributed.Security(require_encryption=True)
    try:
        ssl_context = security.get_connection_args("client").get("ssl_context")
    except OSError as error:  # also for a file that is not a certificate
        raise ClusterError(
            f"{on}: the certificates of Dask's configuration cannot be used: {error}"
        ) from None
    if ssl_context is None or not security.tls_client_cert:
        raise ClusterError(
            f"{on}: Dask's configuration names no certificates; set "
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and "
            "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY to files"
        )
    return security


def _silence_logs() -> None:
    """Silence the logs of Dask, which repeat each failure: ergon reports it once, as a sentence."""
    for name in (*_SILENCED_LOGGERS, *logging.root.manager.loggerDict):
        if name.partition(".")[0] in _SILENCED_LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _start_cluster(stack: contextlib.ExitStack, n_processes: int) -> Any:
    """Start processes on this machine, and try again if one dies meanwhile. Raises ClusterError."""
    from .local_workers import local_cluster

    failure_reason = ""
    for _ in range(_START_ATTEMPTS):
        try:
            return stack.enter_context(local_cluster(n_processes, _TASK_RETRIES))
        except ImportError:  # the library that makes certificates is missing
            raise ClusterError(_missing_package_error("cryptography")) from None
        except NotPrivateError as error:
            raise ClusterError(f"local:{n_processes}: {error}") from None
        except (RuntimeError, OSError) as error:
            failure_reason = str(error)
    raise ClusterError(f"local:{n_processes}: the processes did not start: {failure_reason}")


def _missing_package_error(package: str) -> str:
    return f"--on needs {package}; install what is missing by: {install_command('cluster')}"


def share_work(cluster: Cluster, job: Job) -> SharedWorkers:
    """Workers for the islands of a job."""
    job_future = cluster.client.submit(cluster_worker.return_job, job, pure=False)
    return SharedWorkers(cluster, cluster.executor(), job_future)


def job_of(loaded: Loaded, stage: Stage, rate: float | None, seed: int | None) -> Job:
    """A staged piece as plain data, with the `rate` [Hz] and the `seed` that were asked for.

    Raises NotBundledError.
    """
    plan, planned_accuracy = stage.plan, stage.planned_accuracy
    assert plan is not None
    assert planned_accuracy is not None
    score_path = next(iter(loaded.files))  # the score is read first
    score_content = bundle_score(score_path, loaded)
    plan_text = plan_file.plan_text(
        plan.choices(), plan.hash, budget=dict(budget_of(planned_accuracy))
    )
    plan_digest = hashlib.sha256(plan_text.encode()).hexdigest()
    return Job(
        version=cluster_worker.version(),
        content=score_content,
        plan=plan_text,
        plan_hash=plan.hash,
        rate=rate,
        seed=seed,
        digest=digest(score_content, plan_digest, rate, seed, os.getpid()),
    )
