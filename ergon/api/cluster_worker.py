"""The functions that a worker of a cluster runs: they compute stretches of islands.

`rendering.remote` makes the requests, `api.cluster` the job that all requests share.

The functions are called by name with plain data (bytes, texts, numbers), and return plain data.
They read no file of the client: the score is sent with its files.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.exchange import plan_file
from ergon.rendering.remote import Answer, ClusterError, IslandRequest, Request

from . import score as scores
from .options import AccuracyOptions
from .score_bundle import ScoreBundle, unpack

if TYPE_CHECKING:
    from ergon._core import Simulation, StorableIsland

# Bound on the modules of all staged pieces in memory; a single piece may have any number.
MODULES_MAX = 1_000_000
_STAGED_JOBS_MAX = 16
_FORMAT_VERSION = 1  # version of jobs, requests and answers


class Job(TypedDict):
    """A piece to compute: the score and its files, the text of its plan and the plan's hash, rate
    [Hz] and seed if they are not the score's, and a `digest` of all of these.
    """

    version: list[Any]
    content: ScoreBundle
    plan: str
    plan_hash: str
    rate: float | None
    seed: int | None
    digest: str


def version() -> list[Any]:
    """The versions that must be equal on a worker and on its client."""
    return [_core.__version__, plan_file.PLAN_VERSION, _FORMAT_VERSION]


def check_version(client_version: list[Any]) -> None:
    """Raise ClusterError if the machine that asks has another version."""
    if list(client_version) != version():
        asking_version, worker_version = (
            f"ergon {ergon_version} (plans of version {plan_version}, requests of version "
            f"{request_version})"
            for ergon_version, plan_version, request_version in (client_version, version())
        )
        raise ClusterError(
            f"this worker has {worker_version}, and the machine that asks has {asking_version}; "
            "install the same "
            "version on both"
        )


@dataclass(slots=True, eq=False)
class _StagedJob:
    """A staged piece; given the states of islands, its simulation computes any stretch."""

    digest: str
    simulation: Simulation
    islands: list[StorableIsland]
    n_modules: int


# One stretch at a time: a worker is one process per core. The piece used last is at the end.
staging_lock = threading.Lock()
_staged_jobs: list[_StagedJob] = []


def return_job(job: Job) -> Job:
    """Return the job: as the result of a task, it is sent to each worker only once."""
    return job


def compute_stretch(job: Job, request: Request) -> Answer:
    """Compute a stretch of some islands of a job."""
    start_time = time.perf_counter()
    stretch_answer = Answer(
        worker=f"{socket.gethostname()}:{os.getpid()}", seconds=0.0, sounds=[], states=[]
    )
    with staging_lock:
        try:
            staged_job = _staged_job(job)
            for island_request in request["islands"]:
                sound, state = _compute_island(staged_job, request, island_request)
                stretch_answer["sounds"].append(sound)
                stretch_answer["states"].append(state)
        except _core.DivergedError:
            stretch_answer["diverged"] = True
        except (ErgonError, _core.EngineError, KeyError) as error:
            stretch_answer["refused"] = str(error)
        if "diverged" in stretch_answer or "refused" in stretch_answer:
            stretch_answer["sounds"], stretch_answer["states"] = [], []
    stretch_answer["seconds"] = time.perf_counter() - start_time
    return stretch_answer


def _staged_job(job: Job) -> _StagedJob:
    """The staged piece of a job; the pieces used last stay staged. Raises ErgonError."""
    for staged_job in _staged_jobs:
        if staged_job.digest == job["digest"]:
            _staged_jobs.remove(staged_job)
            _staged_jobs.append(staged_job)
            return staged_job
    check_version(job["version"])
    with unpack(job["content"]) as path:
        plan_path = path.with_name(f"{path.name}.plan")
        plan_path.write_text(job["plan"], encoding="utf-8")
        options = AccuracyOptions(plan=plan_path, seed=job["seed"])
        loaded = scores.read(path, options, Report())
        staged_score = scores.stage_piece(loaded, options, rate=job["rate"])
        staged_plan = staged_score.stage.plan
        if staged_plan is None or staged_plan.hash != job["plan_hash"]:
            raise ClusterError(
                "this worker makes another plan of the same score; install the same ergon"
            )
    simulation, network = staged_score.stage.simulation, staged_score.stage.network
    n_modules = network.n_mat + network.n_lia
    while _staged_jobs and (
        len(_staged_jobs) >= _STAGED_JOBS_MAX or _n_modules() + n_modules > MODULES_MAX
    ):
        _staged_jobs.pop(0)
    _staged_jobs.append(_StagedJob(job["digest"], simulation, simulation.storable(), n_modules))
    return _staged_jobs[-1]


def _n_modules() -> int:
    return sum(staged_job.n_modules for staged_job in _staged_jobs)


def _compute_island(
    staged_job: _StagedJob, request: Request, island_request: IslandRequest
) -> tuple[bytes, bytes]:
    """Compute a stretch of an island: its sound, and its state after it."""
    first_frame, stop_frame, island_index = (
        request["at"],
        request["stop"],
        island_request["number"],
    )
    if not 0 <= island_index < len(staged_job.islands):
        raise ClusterError(
            "this worker finds other islands in the same score; install the same ergon"
        )
    island, simulation = staged_job.islands[island_index], staged_job.simulation
    if (
        simulation.island_key(island, first_frame, stop_frame, island_request["before"])
        != island_request["key"]
    ):
        raise ClusterError(
            "this worker reads the same score in another way; install the same ergon"
        )
    try:
        simulation.set_state(island, island_request["state"])
        sound_frames = (
            simulation.advance(island, stop_frame - first_frame).astype("<f8", copy=False).tobytes()
        )
        return sound_frames, simulation.recorded(island).state
    except BaseException:
        _staged_jobs.remove(staged_job)  # stopped in the middle of a frame
        raise
