"""kill -9 of workers, schedulers and clients: a render ends with its bytes, or goes on to them."""

import hashlib
import os
import random
import shutil
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import ERGON
from patience import PATIENCE, until

psutil = pytest.importorskip("psutil")
pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

GONGS = """\
ergon: 1
rates: {audio: 8000Hz}
accuracy: {method: ca}
instruments:
"""
GONG = (
    "  {name}: {{modules: {{p: {{PLATE: {{shape: hex, radius: {radius}, M: 50g, f: 200Hz, t60: 4s, "
    "hardening: 1e9N/m3}}}}}}, out: {{x: {{SOX: p.3}}}}}}\n"
)
STRIKES = (
    "strikes:\n  s: {to: [a.p.centre, b.p.centre, c.p.centre], at: 0.1s, impulse: 1mNs..5mNs, "
    "every: 1s, times: 40}\nrender: {tail: 5s, bits: float}\n"
)


@pytest.fixture(autouse=True)
def here(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(work_folder / "cache"))
    monkeypatch.delenv("ERGON_CACHE", raising=False)
    instruments = "".join(
        GONG.format(name=name, radius=r) for name, r in zip("abc", (5, 6, 6), strict=True)
    )
    Path("a.yaml").write_text(GONGS + instruments + STRIKES)
    return work_folder


def render(*words: str, **environment: str) -> "subprocess.Popen[bytes]":
    words = (*ERGON, "render", "a.yaml", *words)
    with Path("said.txt").open("wb") as text:
        return subprocess.Popen(words, stderr=text, env={**os.environ, **environment})


def digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@pytest.fixture
def expected(here: Path) -> str:
    assert render("-o", "one.wav", "-q", ERGON_CACHE="plans").wait(PATIENCE) == 0
    return digest("one.wav")


def workers_of(process: "subprocess.Popen[bytes]") -> list[int]:
    """Dask's own worker processes below another, not those that watch them."""
    result = []
    try:
        for child in psutil.Process(process.pid).children(recursive=True):
            if "spawn_main" in " ".join(child.cmdline()):
                result.append(child.pid)
    except psutil.NoSuchProcess:
        pass
    return result


def stored() -> int:
    return len(list(Path().glob("cache/ergon/stretches/*.stretch")))


def kill(number: int) -> bool:
    """Whether the process was there."""
    try:
        os.kill(number, 9)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture(scope="module")
def killed(request: pytest.FixtureRequest) -> Iterator["Counter[str]"]:
    """How many of each were killed; the tally is printed at the end."""
    tally: Counter[str] = Counter()
    yield tally
    if printer := request.config.pluginmanager.get_plugin("terminalreporter"):
        printer.write_line(f"kill -9: {sum(tally.values())}, {dict(tally)}")


def kill_a_worker(dice: random.Random, process: "subprocess.Popen[bytes]") -> bool:
    found = workers_of(process)
    return bool(found) and kill(dice.choice(found))


def finished(expected: str) -> None:
    """The next run gives the bytes, and nothing that was half is left or taken for whole."""
    process = render("-o", "two.wav", "--on", "local:2")
    assert process.wait(PATIENCE) == 0, Path("said.txt").read_text()
    assert digest("two.wav") == expected
    assert not [path for path in Path().iterdir() if path.name.startswith(".")]


def test_render_after_killed_worker_and_client(expected: str):
    dice = random.Random(1)
    process = render("-o", "two.wav", "--on", "local:2")
    until(lambda: stored() >= 3, "stretches")
    kill_a_worker(dice, process)
    before = stored()
    until(lambda: stored() > before or process.poll() is not None, "what goes on")
    process.kill()
    process.wait(PATIENCE)
    assert not Path("two.wav").exists() or digest("two.wav") == expected
    finished(expected)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_render_after_kills_at_random_instants(expected: str, seed: int, killed: "Counter[str]"):
    """Ten kills of workers, or of the client from whose stretches another one goes on."""
    dice = random.Random(seed)
    process, n_kills = render("-o", "two.wav", "--on", "local:2"), 0
    while n_kills < 10:
        if not runs_on(dice, process):
            if process.returncode == 2:  # whoever begins five times is killed five times
                text = Path("said.txt").read_text()
                assert "local:2: the processes did not start" in text
                assert "Traceback" not in text
                assert not Path("two.wav").exists()
            else:
                check_complete(process, expected)
            process = render("-o", "two.wav", "--on", "local:2")
        elif dice.random() < 0.3:
            process.kill()
            process.wait(PATIENCE)
            killed["clients"] += 1
            n_kills += 1
            process = render("-o", "two.wav", "--on", "local:2")
        elif kill_a_worker(dice, process):
            killed["workers"] += 1
            n_kills += 1
    process.wait(PATIENCE)
    check_complete(process, expected)
    finished(expected)


def runs_on(dice: random.Random, process: "subprocess.Popen[bytes]") -> bool:
    """Whether a command still runs after some time."""
    try:
        process.wait(dice.uniform(0.2, 4.0))
    except subprocess.TimeoutExpired:
        return True
    return False


def check_complete(process: "subprocess.Popen[bytes]", expected: str) -> None:
    """It ended well; the next one finds nothing that was computed."""
    assert process.returncode == 0, Path("said.txt").read_text()
    assert digest("two.wav") == expected
    shutil.rmtree("cache", ignore_errors=True)
    Path("two.wav").unlink()


class Dask:
    """A scheduler and two workers, each a process begun as a person begins it."""

    def __init__(self) -> None:
        with socket.socket() as first:
            first.bind(("127.0.0.1", 0))
            self.port = first.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes: list[subprocess.Popen[bytes]] = []
        self.begin()

    def begin(self) -> None:
        dask = [sys.executable, "-m", "dask"]
        here = ["--host", "127.0.0.1"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        words = [*dask, "scheduler", *here, "--port", str(self.port), "--no-dashboard"]
        commands = [words] + 2 * [
            [*dask, "worker", self.address, "--nthreads", "1", "--no-dashboard"]
        ]
        self.processes = [subprocess.Popen(one, **quiet) for one in commands]  # type: ignore[call-overload]

    def end(self) -> None:
        for process in self.processes:
            for number in workers_of(process):
                kill(number)
            process.kill()
            process.wait()


@pytest.fixture
def dask() -> Iterator[Dask]:
    single = Dask()
    yield single
    single.end()


@pytest.mark.slow
def test_render_resumes_after_killed_scheduler(expected: str, dask: Dask):
    process = render("-o", "two.wav", "--on", dask.address)
    until(lambda: stored() >= 2, "stretches")
    dask.processes[0].kill()
    assert process.wait(PATIENCE) == 2
    text = Path("said.txt").read_text()
    assert "Traceback" not in text
    assert "what arrived is kept: the same command goes on from there" in text
    assert not Path("two.wav").exists()
    saved = stored()
    dask.end()
    dask.begin()
    process = render("-o", "two.wav", "--on", dask.address)
    assert process.wait(PATIENCE) == 0, Path("said.txt").read_text()
    assert digest("two.wav") == expected
    assert stored() >= saved


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_render_after_scheduler_kills_at_random_instants(
    expected: str, dask: Dask, seed: int, killed: "Counter[str]"
):
    """Five schedulers, and workers between: each client ends with the bytes or with a sentence."""
    dice = random.Random(seed)
    process, n_kills = render("-o", "two.wav", "--on", dask.address), 0
    while n_kills < 5:
        if not runs_on(dice, process):
            check_complete(process, expected)
        elif dice.random() < 0.3:
            killed["workers"] += kill_a_worker(dice, dask.processes[dice.choice((1, 2))])
            continue
        else:
            dask.processes[0].kill()
            killed["schedulers"] += 1
            n_kills += 1
            if process.wait(PATIENCE) == 0:
                check_complete(process, expected)
            else:
                text = Path("said.txt").read_text()
                assert process.returncode == 2, text
                assert "Traceback" not in text
                assert not Path("two.wav").exists()
            dask.end()
            dask.begin()
        process = render("-o", "two.wav", "--on", dask.address)
    process.wait(PATIENCE)
    check_complete(process, expected)
