"""Where a command meets a machine that refuses: full disks, no HOME, little memory, other signals.

Every refusal is a sentence with an exit code, and what was cut is never called whole.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import pytest
from commands import ERGON, PATIENT, forked
from patience import PATIENCE
from sweep import crossed, few

from ergon import _core
from ergon.repl.session.journal import read_events
from tests.robust.test_kills import LIVE, SCORE

DEVICE = [*ERGON, "emulate", "frame", "--udp", "0", "--json"]
NEVER = ("Traceback", "internal error", "Exception ignored", "panicked", "in ergon itself")
IS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


@pytest.fixture
def here(tmp_path: Path) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "score.yaml").write_text(SCORE.replace("TAIL", "1s"))
    (folder / "long.yaml").write_text(SCORE.replace("TAIL", "36000s"))
    (folder / "live.yaml").write_text(LIVE)
    return folder


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


INPUT_FILES = ["live.yaml", "long.yaml", "score.yaml"]


def limited(kind: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(kind, (most, most))


def ergon(
    folder: Path,
    line: str,
    before: Callable[[], None] | None = None,
    **environment: str | None,
) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command that is started in a strange surrounding."""
    merged = {**os.environ, **environment}
    done = subprocess.run(
        [*ERGON, *line.split()],
        cwd=folder,
        env={name: value for name, value in merged.items() if value is not None},
        input="",
        capture_output=True,
        timeout=PATIENCE,
        text=True,
        preexec_fn=before,
    )
    return calm(done)


def forked_ergon(
    folder: Path,
    line: str,
    *limits: tuple[int, int],
    lines: str = "",
    **environment: str | None,
) -> tuple[int, str, str]:
    """The same of a command whose surrounding becomes strange once Python has started."""
    return calm(forked(line.split(), folder, limits=limits, lines=lines, **environment))


def calm(done: subprocess.CompletedProcess[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr, none of which shows the program's inside."""
    for word in NEVER:
        assert word not in done.stdout + done.stderr, done.stdout + done.stderr
    return done.returncode, done.stdout, done.stderr


# --- disks ----------------------------------------------------------------------------------------


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 KiB with the scores on it."""
    disk = tmp_path / "small"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if not IS_ROOT or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        (disk / "score.yaml").write_text(SCORE.replace("TAIL", "60s"))
        (disk / "live.yaml").write_text(LIVE)
        yield disk
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


WRITERS = (
    "render score.yaml -o x.wav",
    "render score.yaml -o x.wav --stems stems",
    "render score.yaml --freeze bell -o frozen",
    "export score.yaml -o out",
)


@pytest.mark.parametrize("line", WRITERS)
def test_full_disk_refused_without_partial_files(small: Path, line: str) -> None:
    code, _, output = forked_ergon(small, line)
    assert code == 2
    assert " cannot be written: No space left" in output, output
    assert files(small) == ["live.yaml", "score.yaml"]


@pytest.mark.parametrize("line", WRITERS)
def test_file_size_limit_refused_without_partial_files(here: Path, line: str) -> None:
    code, _, output = forked_ergon(here, line, (resource.RLIMIT_FSIZE, 100_000))
    assert code == 2
    assert " cannot be written: File too large" in output, output
    assert files(here) == INPUT_FILES


@pytest.mark.parametrize(
    "line",
    [
        "render score.yaml -o /dev/full",
        "plan score.yaml -o /dev/full",
        "compile score.yaml -o /dev/full",
        "schema -o /dev/full",
    ],
)
def test_write_to_full_device_is_refused(here: Path, line: str) -> None:
    code, _, output = forked_ergon(here, line)
    assert code == 2
    assert "No space left" in output, output


@pytest.mark.parametrize(
    "line",
    few(["info score.yaml", "plan score.yaml", "compile score.yaml", "render score.yaml -o -"], 1),
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_full_standard_output_exit_2(here: Path, line: str, unbuffered: str) -> None:
    """Whether a write fails at once or when the buffer is flushed at the end."""
    words = [*ERGON, *line.split()]
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            words, cwd=here, env=environment, stdout=full, stderr=subprocess.PIPE, text=True
        )
        both = subprocess.run(words, cwd=here, env=environment, stdout=full, stderr=full)
    assert done.returncode == both.returncode == 2
    assert "No space left" in done.stderr
    assert unbuffered or done.stderr == "error: standard output: No space left on device\n"
    assert not [word for word in NEVER if word in done.stderr], done.stderr


@pytest.mark.parametrize("line", ["check score.yaml", "check none.yaml"])
def test_full_standard_error_exit_2(here: Path, line: str) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [*ERGON, *line.split()], cwd=here, stdout=subprocess.DEVNULL, stderr=full
        )
    assert done.returncode == 2


def test_stdout_and_stderr_in_one_file_ordered(here: Path) -> None:
    """The sentence about a warning does not overtake the data printed before it."""
    environment = {**os.environ, "PYTHONUNBUFFERED": ""}
    program = (
        "import sys; from ergon.cli.streams import make_whole; make_whole();"
        "print('first'); print('second', file=sys.stderr); print('third')"
    )
    with (here / "both.txt").open("wb") as both:
        subprocess.run(
            [sys.executable, "-c", program], env=environment, stdout=both, stderr=both, check=True
        )
    assert (here / "both.txt").read_text().split() == ["first", "second", "third"]


def fill(disk: Path) -> None:
    """Nothing more goes onto a disk."""
    with open(disk / "fill", "wb", buffering=0) as file:
        try:
            while file.write(bytes(4096)):
                pass
        except OSError:
            pass


RECORDERS = (
    "take record -o a.take",
    "duet live.yaml --record a.take --audio null --gain 0dB --unchecked",
)


@pytest.mark.parametrize("what", RECORDERS)
def test_take_on_filling_disk_marked_incomplete(small: Path, what: str) -> None:
    device = subprocess.Popen(DEVICE, stdout=subprocess.PIPE, text=True)
    assert device.stdout is not None
    with device:
        try:
            url = json.loads(device.stdout.readline())["url"]
            live = ("ada=" if "duet" in what else "") + url
            both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
            words = [*ERGON, *what.split(), "--live", live, "--json"]
            with subprocess.Popen(words, cwd=small, text=True, **both) as process:
                try:
                    while not (small / "a.take").exists():
                        assert process.poll() is None, process.communicate()
                        time.sleep(0.02)
                    time.sleep(0.5)
                    fill(small)
                    text = ""
                    assert process.stdout is not None
                    while "No space left" not in text:
                        line = process.stdout.readline()
                        assert line, text
                        text += line
                    process.send_signal(signal.SIGINT)
                    rest, _ = process.communicate(timeout=PATIENCE)
                finally:
                    process.kill()
        finally:
            device.kill()
    assert not [word for word in NEVER if word in text + rest], text + rest
    assert process.returncode in (2, 130), rest
    result = _core.read_recording(small / "a.take")
    assert not result.finished


@pytest.mark.parametrize("what", RECORDERS)
def test_take_on_full_disk_is_refused(small: Path, what: str) -> None:
    fill(small)
    with subprocess.Popen(DEVICE, stdout=subprocess.PIPE, text=True) as device:
        assert device.stdout is not None
        url = json.loads(device.stdout.readline())["url"]
        code, _, output = forked_ergon(
            small, f"{what} --live {'ada=' if 'duet' in what else ''}{url}"
        )
        device.kill()
    assert code == 2
    assert "the recording cannot be written: No space left" in output
    assert not (small / "a.take").exists(), "a take of nothing"


def test_journal_on_full_disk_reported(small: Path) -> None:
    fill(small)
    line = "repl score.yaml --audio null --gain 0dB --plain"
    _, out, output = forked_ergon(small, line, lines="play\nada plays knock every 1\nquit\n")
    assert "cannot be written" in out + output
    assert "No space left" in out + output
    if (small / "session.jsonl").exists():
        assert "end" not in [event.name for event in read_events(small / "session.jsonl")]


@pytest.mark.parametrize("line", WRITERS)
def test_read_only_folder_is_refused(tmp_path: Path, here: Path, line: str) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "ro,size=64k", "tmpfs", str(here)]
    line = line.replace("score.yaml", str(tmp_path / "score.yaml"))
    (tmp_path / "score.yaml").write_text(SCORE.replace("TAIL", "1s"))
    if IS_ROOT:  # to whom rights are nothing
        if subprocess.run(mount, capture_output=True).returncode:
            pytest.skip("no disk can be mounted here")
    else:
        here.chmod(0o500)
    try:
        code, _, output = forked_ergon(here, line)
    finally:
        if IS_ROOT:
            subprocess.run(["umount", "-l", str(here)], check=True)
        else:
            here.chmod(0o700)
    assert code == 2
    assert "Read-only" in output or "Permission denied" in output, output


# --- environments ---------------------------------------------------------------------------------

LINES = (
    "check score.yaml",
    "render score.yaml -o x.wav",
    "plan score.yaml",
    "devices",
    "info score.yaml",
    "repl score.yaml --audio null --gain 0dB --plain",
)


ENVIRONMENTS: dict[str, dict[str, str | None]] = {
    "no HOME": {
        "HOME": None,
        "XDG_CACHE_HOME": None,
        "XDG_RUNTIME_DIR": None,
        "ERGON_CACHE": "on",
    },
    "HOME is nowhere": {"HOME": "/nonexistent", "XDG_CACHE_HOME": None, "ERGON_CACHE": "on"},
    "HOME is empty": {"HOME": "", "XDG_CACHE_HOME": "/dev/null/x", "ERGON_CACHE": "on"},
    "C": {"LANG": "C", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    "TMPDIR is nowhere": {"TMPDIR": "/nonexistent", "TERM": "nothing"},
    "a terminal of no size": {"COLUMNS": "0", "LINES": "-1", "TERM": ""},
    "a terminal of a size that is no number": {"COLUMNS": "wide", "LINES": "long"},
    "a time zone that is not there": {"TZ": "../../Nowhere"},
    "folders that are relative": {
        "XDG_CACHE_HOME": "here",
        "XDG_CONFIG_HOME": "here",
        "XDG_STATE_HOME": "here",
        "XDG_RUNTIME_DIR": "here",
        "ERGON_CACHE": "on",
    },
    "Python without assertions": {"PYTHONOPTIMIZE": "2"},
    "Python whose warnings are errors": {"PYTHONWARNINGS": "error"},
}
# What Python reads as it starts; the others ergon reads, when it is called.
PYTHON_ENVIRONMENTS = ("C", "Python without assertions", "Python whose warnings are errors")


@pytest.mark.parametrize(("name", "line"), crossed([*ENVIRONMENTS], LINES))
def test_commands_without_environment_variables(here: Path, name: str, line: str) -> None:
    before = files(here)
    started = ergon if name in PYTHON_ENVIRONMENTS else forked_ergon
    code, _, output = started(here, line, **ENVIRONMENTS[name])
    assert code == 0, output
    assert not [path for path in files(here) if path not in before and "." not in path]


@pytest.mark.parametrize("line", few(LINES, ["render score.yaml -o x.wav"]))
def test_commands_with_read_only_home(tmp_path: Path, here: Path, line: str) -> None:
    home = tmp_path / "home"
    home.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "ro,size=64k", "tmpfs", str(home)]
    if not IS_ROOT:
        home.chmod(0o500)
    elif subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    folders: dict[str, str | None] = {"HOME": str(home), "ERGON_CACHE": "on"}
    folders |= {f"XDG_{name}": None for name in ("CACHE_HOME", "CONFIG_HOME", "STATE_HOME")}
    try:
        code, _, output = ergon(here, line, **folders)
    finally:
        if IS_ROOT:
            subprocess.run(["umount", "-l", str(home)], check=True)
    assert code == 0, output


@pytest.mark.parametrize(("limit", "line"), few(product([8, 16], LINES), 3))
def test_commands_with_few_file_descriptors(here: Path, line: str, limit: int) -> None:
    code, out, output = ergon(here, line, limited(resource.RLIMIT_NOFILE, limit))
    assert code in (0, 2, 3), output
    assert code == 0 or output.strip() or out.strip()
    assert not [name for name in files(here) if name.endswith(".part")]


@pytest.mark.parametrize("limit", few([300, 600, 900], 1))  # [MB]: numpy alone maps some hundred
@pytest.mark.parametrize(
    "line", ["check score.yaml", "render long.yaml -o x.wav --normalise -1dB -n"]
)
def test_commands_with_little_memory(here: Path, line: str, limit: int) -> None:
    done = subprocess.run(
        [*ERGON, *line.split()],
        cwd=here,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=limited(resource.RLIMIT_AS, limit << 20),
    )
    assert done.returncode >= 0, "it ends by itself"
    assert files(here) == INPUT_FILES


# --- signals --------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", few([signal.SIGTERM, signal.SIGHUP, signal.SIGINT], 1))
@pytest.mark.parametrize(
    ("line", "begun"),
    [
        ("render long.yaml -o x.wav", ".x.wav.*.part"),
        ("render long.yaml --freeze bell -o frozen", "frozen/.*.part"),
        ("repl score.yaml --audio null --gain 0dB --plain", "session.jsonl"),
    ],
)
def test_signal_ends_command_without_files(
    here: Path, number: signal.Signals, line: str, begun: str
) -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([*ERGON, *line.split()], cwd=here, text=True, **pipes) as process:
        try:
            while not list(here.glob(begun)):
                assert process.poll() is None, process.communicate()
                time.sleep(0.02)
            if "repl" in line:  # a journal in which nothing has begun is taken away
                assert process.stdin is not None
                assert process.stdout is not None
                process.stdin.write("play\n")
                process.stdin.flush()
                while "ok" not in (output := process.stdout.readline()):
                    assert output
            process.send_signal(number)
            out, printed = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 128 + number, printed
    assert not [word for word in NEVER if word in out + printed], printed
    assert [name for name in files(here) if name not in INPUT_FILES] == (
        ["session.jsonl"] if "repl" in line else []
    )


def test_render_to_closed_pipe_ends_silently(here: Path) -> None:
    """`ergon render -o - | head -c 100`: no message, no file."""
    shell = f"{' '.join(ERGON)} render long.yaml -q -o - --bits float | head -c 100 | wc -c"
    words = ["bash", "-c", shell]
    done = subprocess.run(words, cwd=here, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stdout.strip() == "100", done
    assert done.stderr == ""
    assert files(here) == INPUT_FILES


# --- two at once ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_simultaneous_renders_to_one_file(here: Path) -> None:
    line = [*ERGON, "render", "score.yaml", "-q", "-o"]
    subprocess.run([*line, "one.wav"], cwd=here, check=True)
    both = [subprocess.Popen([*line, "x.wav"], cwd=here, stderr=subprocess.PIPE) for _ in range(4)]
    for process in both:
        _, output = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, output
    assert (here / "x.wav").read_bytes() == (here / "one.wav").read_bytes()
    assert files(here) == sorted([*INPUT_FILES, "one.wav", "x.wav"])


def test_simultaneous_sessions_in_one_folder(here: Path) -> None:
    line = [*PATIENT, "repl", "score.yaml", "--audio", "null", "--gain", "0dB", "--plain"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    both = [subprocess.Popen(line, cwd=here, text=True, **pipes) for _ in range(3)]
    for number, process in enumerate(both):
        out, output = process.communicate(f"gain bell -{number + 1}dB\n", timeout=PATIENCE)
        assert process.returncode == 0, output
        assert "ok" in out
    result = set()
    for name in ("session.jsonl", "session-2.jsonl", "session-3.jsonl"):
        events = list(read_events(here / name))
        assert events[-1].name == "end"
        result |= {str(event.fields["line"]) for event in events if event.name == "line"}
    assert result == {f"gain bell -{number}dB" for number in (1, 2, 3)}


# --- what is no file ------------------------------------------------------------------------------

READERS = (
    "check {}",
    "render {} -o x.wav",
    "render score.yaml --plan {} -o x.wav",
    "render live.yaml --hands {} -o x.wav",
    "render {}.jsonl -o x.wav",
    "play score.yaml --frozen {} --audio null:fast",
    "duet live.yaml --standin ada={} --audio null:fast",
    "repl {} --audio null",
    "repl score.yaml --resume {} --audio null",
    "info {}",
    "take info {}",
    "stats {}",
    "take trim {} -o y.take",
    "take import {} -o y.take",
    "take export {} -o y.csv",
    "take list {}",
    "fmt {}",
    "compile {}",
    "plan {}",
    "plot {} g",
    "export {} -o out",
    "chart {}",
    "stability {}",
)


@pytest.mark.parametrize("line", READERS)
def test_readers_refuse_fifos_folders_and_devices(here: Path, line: str) -> None:
    """A pipe that nobody writes to, a folder, a device without an end: a sentence, in 2 GB."""
    captured = (".c3d", ".bvh", ".trc", ".tsv", ".sdif")
    suffixes = (".csv", ".npz", ".wav", *captured) if "take import" in line else ("",)
    if "take" in line or "stats" in line or "--hands" in line:
        suffixes = suffixes if "import" in line else (".take",)
    for suffix in suffixes:
        for what in ("fifo", "folder", "zero"):
            name = f"{what}{suffix}"
            path = here / (name if "{}.jsonl" not in line else f"{what}.jsonl")
            if not os.path.lexists(path):
                if what == "fifo":
                    os.mkfifo(path)
                elif what == "folder":
                    path.mkdir()
                else:
                    path.symlink_to("/dev/zero")
            before = files(here)
            code, out, output = forked_ergon(here, line.format(name), (resource.RLIMIT_AS, 4 << 30))
            empty = "take list" in line and what == "folder"
            assert code in ((0,) if empty else (1, 2)), (name, output)
            assert output.strip() or out.strip(), name
            assert files(here) == before


def test_load_refuses_non_files(here: Path) -> None:
    os.mkfifo(here / "fifo")
    (here / "folder").mkdir()
    line = "repl score.yaml --audio null --gain 0dB --plain"
    lines = "load /dev/zero\nload fifo\nload folder\nload /dev/full\nreload\n"
    code, out, output = forked_ergon(here, line, (resource.RLIMIT_AS, 4 << 30), lines=lines)
    assert code == 0, output
    assert "loaded" not in out
