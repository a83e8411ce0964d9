"""Islands that other processes compute: the bytes of one machine, in any order."""

from __future__ import annotations

import random
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from sweep import few

from ergon import _core
from ergon.api import cluster, cluster_worker
from ergon.api import score as scores
from ergon.api.cluster_worker import Job
from ergon.api.options import RenderOptions
from ergon.api.render import PreparedRender, prepare
from ergon.common.report import Report
from ergon.exchange.stretch_store import StretchStore
from ergon.rendering import resumed, stretches
from ergon.rendering.remote import Answer, ClusterError, RemoteSimulation, Request, group_by_cost
from ergon.rendering.resumed import ResumedSimulation

from .test_resumed import SCENES, text

PIECE = """\
ergon: 1
accuracy: {accuracy}
keys: {{k1: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
instruments:
  wire: {{modules: {{s: {{STRING: {{masses: 8, M: 4g, f: D4, t60: 2s}}}},
    b: {{BUT: {{between: [k1, s.3], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}}}}},
    out: {{x: {{SOX: s.5}}}}}}
  gong: {{modules: {{p: {{PLATE: {{shape: hex, radius: 2, M: 50g, f: 900Hz, t60: 1s,
    hardening: 1e10N/m3}}}}}}, out: {{x: {{SOX: p.1}}, v: {{SOV: p.0}}}}}}
  bell: {{modules: {{m: {{CEL: {{M: 2g, f: 440Hz, t60: 0.5s}}}},
    n: {{CEL: {{M: 2g, f: 500Hz, t60: 0.5s}}}}, l: {{LNL: {{between: [m, n], law: "k*d + q*d**3",
    k: 20N/m, q: 4e6N/m3}}}}}}, out: {{x: {{SOX: m}}}}}}
  dust: {{modules: {{d: {{BANK: {{f: [300Hz, 400Hz, 555Hz], t60: 0.3s, M: 1g}}}}}},
    out: {{x: {{SOX: d.0}}}}}}
gestures: {{knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}}
players: {{ada: {{key: k1}}}}
parts: {{ada: [{{at: 1|1, play: knock, every: 1, times: 2}}]}}
strikes:
  a: {{to: [gong.p.centre, bell.m, dust.d.0], at: 0.1s, impulse: 1mNs..3mNs, every: 0.2s, times: 5}}
render: {{tail: 0.3s, bits: float}}
"""


class Workers:
    """Some copies of what a worker is, in this process; answers come in any order.

    `spoil` changes an answer before it is taken.
    """

    def __init__(
        self,
        job: Job,
        count: int,
        seed: int = 0,
        spoil: Callable[[Request, Answer], Answer] = lambda request, answer: answer,
    ) -> None:
        self.count, self.job, self.spoil = count, job, spoil
        self._dice = random.Random(seed)
        self._waiting: list[tuple[Request, Future[Answer]]] = []
        self._ready: list[list[cluster_worker._StagedJob]] = [[] for _ in range(count)]
        self.n_computed = 0

    def submit(self, request: Request) -> Future[Answer]:
        future: Future[Answer] = Future()
        self._waiting.append((request, future))
        return future

    def wait(self, futures: Sequence[Future[Answer]]) -> None:
        assert any(future.done() for future in futures) or self._waiting
        request, future = self._waiting.pop(self._dice.randrange(len(self._waiting)))
        memory = self._dice.choice(self._ready)
        cluster_worker._staged_jobs[:] = memory
        answer = cluster_worker.compute_stretch(self.job, request)
        memory[:] = cluster_worker._staged_jobs
        self.n_computed += 1
        future.set_result(self.spoil(request, answer))

    def answer(self, future: Future[Answer]) -> Answer:
        return future.result()

    def receive(self, answer: Answer, n_frames: int) -> None:
        assert n_frames > 0


@pytest.fixture(autouse=True)
def small(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stretches of 4,096 frames, of islands of any cost."""
    monkeypatch.setenv("ERGON_CACHE", "plans")
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", 4096)
    monkeypatch.setattr(stretches, "_NS_PER_SAMPLE", 0.0)
    monkeypatch.setattr(cluster_worker, "_staged_jobs", [])


def prepared(score: str, **options: object) -> PreparedRender:
    Path("a.yaml").write_text(score)
    asked = RenderOptions(threads=1, **options)  # type: ignore[arg-type]
    return prepare(scores.read("a.yaml", asked), "-", asked, Report())


def job_of(home: PreparedRender) -> Job:
    options = home.options
    return cluster.job_of(home.loaded, home.stage, options.rate, options.seed)


def frames(source: object, n_frames: int, block: int = 1000) -> NDArray[np.float64]:
    out = np.zeros((n_frames, source.n_out))  # type: ignore[attr-defined]
    for index in range(0, n_frames, block):
        source.process(out[index : index + block])  # type: ignore[attr-defined]
    return out


def report_values(home: PreparedRender) -> str:
    """What the gestures' reports say, to the last digit."""
    names = [name for name in dir(_core.Report) if name[0] != "_"]
    reports = home.stage.simulation.reports()
    assert len(reports) == 2
    return repr([[getattr(one, name) for name in names] for one in reports])


@pytest.mark.parametrize(
    ("accuracy", "count"),
    few([("{error: -50dB}", 3), ("{method: ca}", 1), ("{method: ca}", 4)], 1),
)
def test_remote_render_equals_local_samples(accuracy: str, count: int):
    score = PIECE.format(accuracy=accuracy)
    first = prepared(score)
    n_frames = first.stage.n_frames
    expected = frames(first.stage.simulation, n_frames)
    assert np.abs(expected).max(axis=0).min() > 0.0
    for seed in range(2):
        home = prepared(score)
        workers = Workers(job_of(home), count, seed)
        shared = RemoteSimulation(home.stage.simulation, workers, None, n_frames)
        assert (frames(shared, n_frames, 700 + seed) == expected).all()
        assert workers.n_computed >= n_frames // 4096
        assert shared.n_computed == len(home.stage.simulation.storable()) * n_frames
        # What islands tell of themselves at the end.
        assert home.stage.simulation.finer() == first.stage.simulation.finer()
        assert report_values(home) == report_values(first)


@pytest.mark.parametrize("accuracy", ["{error: -50dB}", "{method: ca}"])
def test_recalled_simulation_reports_as_computed(
    accuracy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """All is recalled of a piece, and of a part all but the stretch in which it stops."""
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    score, store = PIECE.format(accuracy=accuracy), StretchStore(tmp_path / "store")
    n_frames = prepared(score).stage.n_frames
    assert n_frames % 4096, "the last stretch is a short one"
    for last, is_known in ((n_frames, False), (n_frames, True), (n_frames - 5, True)):
        first, home = prepared(score), prepared(score)
        expected = frames(first.stage.simulation, last)
        known = ResumedSimulation(home.stage.simulation, store, n_frames, last)
        assert (frames(known, last) == expected).all()
        assert (known.n_recalled > 0) == is_known
        assert (known.n_computed > 0) == (not is_known or last < n_frames)
        assert home.stage.simulation.finer() == first.stage.simulation.finer()
        assert home.stage.simulation.gains() == first.stage.simulation.gains()
        assert report_values(home) == report_values(first)


@pytest.mark.parametrize("scene", few(SCENES, ("modes",)))
def test_remote_render_of_every_body_kind(scene: str):
    score = text(scene).replace("{late}", "3.9")
    first = prepared(score, draft=False)
    n_frames = min(first.stage.n_frames, 30_000)
    expected = frames(first.stage.simulation, n_frames)
    home = prepared(score)
    shared = RemoteSimulation(home.stage.simulation, Workers(job_of(home), 2), None, n_frames)
    assert (frames(shared, n_frames) == expected).all()


def test_remote_render_with_seed_rate_and_method():
    score = PIECE.format(accuracy="{error: -50dB}")
    for options in ({"seed": 7, "rate": 22_050.0}, {"draft": True}, {"method": "ca"}):
        first, home = prepared(score, **options), prepared(score, **options)
        shared = RemoteSimulation(
            home.stage.simulation, Workers(job_of(home), 2), None, first.stage.n_frames
        )
        n_frames = first.stage.n_frames
        assert (frames(shared, n_frames) == frames(first.stage.simulation, n_frames)).all(), options


def test_remote_render_resumes_from_stored_stretches(tmp_path: Path):
    """A render that ends in the middle goes on from there, and by fewer requests."""
    score = PIECE.format(accuracy="{error: -50dB}")
    single = prepared(score)
    n_frames = single.stage.n_frames
    expected = frames(single.stage.simulation, n_frames)
    store = StretchStore(tmp_path / "stretches")
    first, second = (prepared(score) for _ in range(2))
    workers = Workers(job_of(first), 2)
    frames(RemoteSimulation(first.stage.simulation, workers, store, n_frames), n_frames // 2)
    done = workers.n_computed
    again = Workers(job_of(second), 2)
    shared = RemoteSimulation(second.stage.simulation, again, store, n_frames)
    assert (frames(shared, n_frames) == expected).all()
    assert shared.recalled_share > 0.4
    assert 0 < again.n_computed < done


def test_remote_render_same_divergence_message():
    score = PIECE.format(accuracy="{method: ca}").replace("q: 4e6N/m3", "q: 1e17N/m3")
    score = score.replace("render:", "  b: {to: [bell.m], at: 0.3s, impulse: 10Ns}\nrender:")
    messages = []
    for is_shared in (False, True):
        home = prepared(score)
        source: object = home.stage.simulation
        if is_shared:
            workers = Workers(job_of(home), 2)
            n_frames = home.stage.n_frames
            source = RemoteSimulation(home.stage.simulation, workers, None, n_frames)
        with pytest.raises(Exception, match="diverged") as raised:
            frames(source, home.stage.n_frames)
        messages.append(str(raised.value))
    assert "0.300 s" in messages[0]
    assert messages[0] == messages[1]


def _other_key(job: Job, request: Request) -> None:
    request["islands"][0]["key"] = "0" * 64


def _no_island(job: Job, request: Request) -> None:
    request["islands"][0]["number"] = 99


def _cut_state(job: Job, request: Request) -> None:
    request["islands"][0]["state"] = request["islands"][0]["state"][:-3]


def _other_version(job: Job, request: Request) -> None:
    job["version"] = ["0.0.7", *job["version"][1:]]


def _other_plan(job: Job, request: Request) -> None:
    job["plan_hash"] = "0" * 64


def _a_way_out(job: Job, request: Request) -> None:
    job["content"]["files"]["../evil.yaml"] = b"ergon: 1"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_other_key, "this worker reads the same score in another way; install the same ergon"),
        (_no_island, "this worker finds other islands"),
        (_cut_state, "state"),
        (_other_version, "and the machine that asks has ergon 0.0.7"),
        (_other_plan, "this worker makes another plan of the same score"),
        (_a_way_out, "'../evil.yaml' is not a file of this score"),
    ],
)
def test_remote_render_refuses_mismatched_workers(
    change: Callable[[Job, Request], None], message: str
):
    home = prepared(PIECE.format(accuracy="{error: -50dB}"))
    job = job_of(home)
    workers = Workers(job, 1)
    submit = workers.submit

    def changed(request: Request) -> Future[Answer]:
        change(job, request)
        return submit(request)

    workers.submit = changed  # type: ignore[method-assign]
    shared = RemoteSimulation(home.stage.simulation, workers, None, home.stage.n_frames)
    with pytest.raises(ClusterError, match=f"worker .*: .*{re.escape(message)}"):
        frames(shared, 5000)


def test_remote_render_refuses_wrong_answer_length():
    home = prepared(PIECE.format(accuracy="{error: -50dB}"))

    def cut(request: Request, answer: Answer) -> Answer:
        answer["sounds"][0] = answer["sounds"][0][8:]
        return answer

    workers = Workers(job_of(home), 2, spoil=cut)
    shared = RemoteSimulation(home.stage.simulation, workers, None, home.stage.n_frames)
    with pytest.raises(ClusterError, match="sent sounds of another length"):
        frames(shared, 5000)


def test_group_by_cost_balanced_groups():
    costs = [5.0, 3.0, 3.0, 2.0, 2.0, 1.0]
    groups = group_by_cost(costs, 3)
    assert sorted(i for group in groups for i in group) == list(range(6))
    # The least possible: 16 by 3.
    assert max(sum(costs[i] for i in group) for group in groups) == 6.0
    assert group_by_cost([1.0], 4) == [[0]]
    assert group_by_cost([], 4) == []


FAILING = """
import logging
from ergon.api import cluster
cluster._CONNECT_SECONDS_MAX = 0.1
try:
    with cluster.open_cluster("tcp://127.0.0.1:9", print):
        pass
except cluster.ClusterError as error:
    print(error)
for name in ("tornado.application", "distributed.core", "asyncio"):
    logging.getLogger(name).error("Exception in callback")
"""


def test_remote_failure_reported_once_without_dask_logs():
    done = subprocess.run([sys.executable, "-c", FAILING], capture_output=True, text=True)
    assert "tcp://127.0.0.1:9: no " in done.stdout
    assert done.stderr == ""
