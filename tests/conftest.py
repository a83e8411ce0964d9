"""What all tests share: the environment, the order of files, folders."""

import gc
import os
import signal
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import hypothesis
import needed
import pytest

os.environ["ERGON_CACHE"] = "off"
# An example may take as long as a busy machine lets it; hypothesis' own profile for CI says so too.
if "CI" not in os.environ:
    hypothesis.settings.register_profile("busy", deadline=None)
    hypothesis.settings.load_profile("busy")
# Most of a short run is planning, and the same scores run hundreds of times: all share the plans of
# one run of the tests, but for these folders, which are about planning or about determinism.
_PLAN_ANEW = ("contracts", "engine", "lab", "plan")
# Each worker has about one processor: four that each solve with four threads wait for one another.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# Versions of scores are large trees without cycles: the search for cycles in them took a sixth of
# the tests of sessions.
gc.set_threshold(100_000, 20, 20)
# Where bytecode is not kept, each of a thousand commands compiles all modules: half of its time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# What a shell starts in the background ignores Ctrl-C, what nohup starts SIGHUP, and both hand that
# on to all that they start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Files are shared out whole: all wait for a long one that is begun last.
_FIRST = (
    "house/test_wheel.py",
    "metrology/test_stages.py",
    "lab/test_lab_maps.py",
    "view/test_page.py",
    "robust/test_conditions.py",
    "rendering/test_resumed.py",
    "house/test_docs.py",
    "lab/test_lab_slow_key_scene.py",
    "scores/test_memory.py",
    "rendering/test_frozen.py",
    "repl/test_repl_live.py",
    "cli/test_cli_streams.py",
    "fuzz/test_fuzzers.py",
    "plan/test_plan_random.py",
    "engine/test_glide_references.py",
    "live/test_duet_lockstep.py",
    "live/test_live_plausible.py",
    "live/test_duet_proof.py",
    "cli/test_every_command.py",
    "repl/test_repl_random_devices.py",
)


def pytest_xdist_auto_num_workers() -> int | None:
    """One worker more than processors: tests of devices, servers and browsers often wait."""
    single = "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ
    return None if single else (os.cpu_count() or 1) + 1


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--no-skips", action="store_true", help="a skipped test is a failed one")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if item.config.getoption("no_skips"):
        needed.as_failure(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if collector.config.getoption("no_skips"):
        needed.as_failure(report)
    return report


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the tests that were skipped, and what would bring them."""
    if lines := needed.skipped_lines(terminalreporter.stats.get("skipped", ())):
        terminalreporter.section("skipped here")
        for line in lines:
            terminalreporter.write_line(line)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the others as they are collected."""
    place = {name: at for at, name in enumerate(_FIRST)}
    folder = Path(__file__).parent
    files = {item.path: item.path.relative_to(folder).as_posix() for item in items}
    items.sort(key=lambda item: place.get(files[item.path], len(place)))


@pytest.fixture(autouse=True, scope="session")
def private_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What ergon notes of the files that it writes is not noted in the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def shared_plans(
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Plans are kept in a folder that all workers share, for the tests that are not about them."""
    if request.path.relative_to(Path(__file__).parent).parts[0] not in _PLAN_ANEW:
        base = tmp_path_factory.getbasetemp()
        shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
        monkeypatch.setenv("ERGON_CACHE", "plans")
        monkeypatch.setenv("XDG_CACHE_HOME", str(shared / "cache"))


@pytest.fixture(autouse=True)
def patient_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of tests may be long."""
    from ergon.repl.session import computing

    monkeypatch.setattr(computing, "LINE_STEPS", 1 << 60)
    monkeypatch.setattr(computing, "FILES_STEPS", 1 << 60)


@pytest.fixture
def work_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, empty and the test's own; messages have no colour."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    return tmp_path


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder whose name is short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="ergon-") as name:
        yield Path(name)
