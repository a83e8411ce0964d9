"""What starting costs: nothing happens at import, and the list of commands loads no library."""

import json
import os
import subprocess
import sys
from pathlib import Path

HEAVY = {"numpy", "numba", "soundfile", "rich", "yaml", "prompt_toolkit", "watchfiles"}

# Imports every module of the package in one process, and says what happened besides.
IMPORT_ALL = """
import json, os, pkgutil, sys, threading

done = []
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = ("os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.chmod", "os.system", "os.exec",
           "os.fork", "os.posix_spawn", "subprocess.Popen", "socket.__new__", "tempfile.mkstemp",
           "tempfile.mkdtemp", "shutil.copyfile", "signal.pthread_kill")

def watch(event, args):
    if event == "open" and isinstance(args[2], int) and args[2] & WRITES:
        done.append(f"open {args[0]}")
    elif event in CHANGES:
        done.append(f"{event} {args[:1]}")

import ergon, signal
import numpy, yaml  # what libraries do at import is theirs
handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGPIPE)}
environment, folder = dict(os.environ), os.getcwd()
sys.addaudithook(watch)
names = []
for module in pkgutil.walk_packages(ergon.__path__, "ergon."):
    __import__(module.name)
    names.append(module.name)
if dict(os.environ) != environment or os.getcwd() != folder:
    done.append("environment")
if any(signal.getsignal(n) != handler for n, handler in handlers.items()):
    done.append("signal handlers")
tasks = len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1
report = {"names": names, "done": list(done), "threads": threading.active_count(), "tasks": tasks}
with os.fdopen(3, "w") as out:
    json.dump(report, out)
"""


def loaded_after(code: str) -> set[str]:
    """Top-level names of all modules that a fresh interpreter holds after `code`."""
    ask = "import sys; print(*{name.partition('.')[0] for name in sys.modules}, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{ask}"], capture_output=True, text=True, check=True
    )
    return set(done.stderr.split())


def test_help_loads_no_library():
    # `-X importtime` sees also what was imported and thrown away again.
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "ergon.cli", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "click" in imported
    assert not {name for name in imported if name.partition(".")[0] in HEAVY}
    assert "ergon._core" not in imported
    assert "render" in done.stdout


def test_import_of_ergon_loads_only_itself():
    plain = loaded_after("pass")
    assert loaded_after("import ergon") - plain == {"ergon"}


def test_load_without_sound_libraries(tmp_path: Path):
    (tmp_path / "s.yaml").write_text("ergon: 1\nkeys: {k: {M: 400g, K: 60N/m}}\n")
    score = str(tmp_path / "s.yaml")
    code = f"from ergon.scores.reading.load import load\nassert load({score!r}).piece"
    assert not loaded_after(code) & {"numba", "soundfile", "rich", "prompt_toolkit"}


def test_modules_import_without_side_effects(tmp_path: Path):
    read, write = os.pipe()
    # numpy's BLAS starts threads of its own unless told not to.
    quiet = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    code = f"import os; os.dup2({write}, 3)\n{IMPORT_ALL}"
    paths = [
        str(Path(path).resolve()) for path in os.environ.get("PYTHONPATH", "").split(":") if path
    ]
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, **quiet, "PYTHONPATH": os.pathsep.join(paths)},
        pass_fds=(write,),
        check=False,
    )
    os.close(write)
    with os.fdopen(read) as report:
        assert done.returncode == 0, done.stderr
        result = json.load(report)
    assert {"ergon.cli.app", "ergon.scores.reading.load", "ergon.instruments.module_kinds"} <= set(
        result["names"]
    )
    assert result["done"] == []
    assert (result["threads"], result["tasks"]) == (1, 1)
    assert (done.stdout, done.stderr) == ("", "")
    assert list(tmp_path.iterdir()) == []
