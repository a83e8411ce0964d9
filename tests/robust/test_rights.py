"""Rights of all that is written, under any umask: what ergon keeps is its owner's alone, what it
was asked for nobody else may change unless the umask lets a group do so, and its owner may use all.
"""

from __future__ import annotations

import os
import stat
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from commands import ERGON
from patience import PATIENCE
from second_user import as_second_user, needs_root
from sweep import crossed

from ergon.common.private import make_private_folder, runtime_folder, set_umask
from ergon.exchange.cache_folder import CacheFolder
from tests.robust.test_kills import LIVE, SCORE

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no rights of users here")
UMASKS = (0o000, 0o002, 0o022, 0o077, 0o777)
PRIVATE_FOLDERS = ("cache", "state", "run", "tmp")  # folders for what ergon keeps by itself

# Commands and what they read from their input, each of which writes something else.
COMMANDS = {
    "render score.yaml -o new/x.wav --stems new/stems --motion": "",
    "render score.yaml -o x.flac --freeze bell": "",
    "plan score.yaml -o x.plan": "",
    "export score.yaml -o exported": "",
    "new made": "",
    "sweep score.yaml --vary seed=1,2 -o swept": "",
    "modes score.yaml --csv x.csv --svg x.svg": "",
    "play score.yaml --audio file:played.wav --gain 0dB": "",
    "repl live.yaml --audio null --gain 0dB --plain": "play\nsave saved.yaml\nquit\n",
    "repl --socket run/s live.yaml --audio null --gain 0dB": "",
}


def rights(folder: Path) -> dict[str, int]:
    return {
        str(path.relative_to(folder)): stat.S_IMODE(path.lstat().st_mode)
        for path in folder.rglob("*")
        if not path.is_symlink()
    }


def run(folder: Path, line: str, lines: str, umask: int, seen: Callable[[], None]) -> None:
    """Run a command with an environment of its own, and look at what is there while it runs."""
    variables = {
        "HOME": folder / "home",
        "TMPDIR": folder / "tmp",
        "XDG_CACHE_HOME": folder / "cache" / "made",
        "XDG_STATE_HOME": folder / "state" / "made",
        "XDG_RUNTIME_DIR": folder / "run",
        "ERGON_CACHE": "",
    }
    environment = {**os.environ, **{name: str(value) for name, value in variables.items()}}
    with subprocess.Popen(
        [*ERGON, *line.split()],
        cwd=folder,
        env=environment,
        umask=umask,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        if "--socket" in line:
            process.stdout.readline()  # it is served
            seen()
            process.terminate()
        output = process.communicate(lines, PATIENCE)[0]
        code = process.returncode
    assert code == 0 or "--socket" in line, output
    seen()


@pytest.fixture
def folder(short_folder: Path) -> Path:
    short_folder.chmod(0o755)
    for name in ("home", *PRIVATE_FOLDERS):
        (short_folder / name).mkdir(mode=0o700)
    (short_folder / "score.yaml").write_text(SCORE.replace("TAIL", "1s"))
    (short_folder / "live.yaml").write_text(LIVE)
    return short_folder


def check(folder: Path, before: dict[str, int], umask: int) -> None:
    """What is there is right, but for what was there before."""
    new = {name: mode for name, mode in rights(folder).items() if name not in before}
    assert new
    for name, mode in new.items():
        is_folder = (folder / name).is_dir()
        least = 0o700 if is_folder else 0o600
        greatest = (0o777 if is_folder else 0o666) & ~(umask & 0o077 | 0o002) | least
        if Path(name).parts[0] in PRIVATE_FOLDERS and is_folder:
            greatest = 0o700
        assert mode & least == least, (name, oct(mode))
        assert not mode & ~greatest & ~0o111, (name, oct(mode))


@pytest.mark.parametrize(("line", "umask"), crossed(list(COMMANDS), UMASKS))
def test_file_modes_of_commands_under_umask(folder: Path, line: str, umask: int) -> None:
    before = rights(folder)
    run(folder, line, COMMANDS[line], umask, lambda: check(folder, before, umask))


def test_replaced_file_preserves_mode(folder: Path) -> None:
    for mode in (0o600, 0o640, 0o666):
        (folder / "x.plan").write_text("")
        (folder / "x.plan").chmod(mode)
        run(folder, "plan score.yaml -o x.plan", "", 0o022, lambda: None)
        assert rights(folder)["x.plan"] == mode


def test_temporary_file_private_to_owner(folder: Path) -> None:
    from ergon.exchange.safe import open_for_writing

    with open_for_writing(folder / "x.txt", binary=False) as file:
        (part,) = [path for path in folder.iterdir() if path.name.endswith(".part")]
        assert stat.S_IMODE(part.stat().st_mode) == 0o600
        file.write(b"x")


def test_private_umask_of_commands() -> None:
    before = os.umask(0)
    try:
        for umask, now in {
            0: 0o002,
            0o022: 0o022,
            0o027: 0o027,
            0o777: 0o077,
            0o700: 0o002,
        }.items():
            os.umask(umask)
            set_umask()
            assert os.umask(0) == now
    finally:
        os.umask(before)


@pytest.mark.parametrize("umask", UMASKS)
def test_created_folders_private_in_library(tmp_path: Path, umask: int) -> None:
    tmp_path.chmod(0o700)
    before = os.umask(umask)
    try:
        make_private_folder(tmp_path / "a" / "b" / "c")
        runtime = runtime_folder({"XDG_RUNTIME_DIR": str(tmp_path)})
        store = CacheFolder(tmp_path / "cache" / "ergon" / "plans", ".json", 10, 1000, 1000)
        assert store.write("0" * 64, b"kept")
    finally:
        os.umask(before)
    assert {mode for name, mode in rights(tmp_path).items() if Path(tmp_path, name).is_dir()} == {
        0o700
    }
    assert runtime == tmp_path / "ergon"


def test_cache_writable_by_others_ignored(tmp_path: Path) -> None:
    store = CacheFolder(tmp_path / "ergon" / "plans", ".json", 10, 1000, 1000)
    key = "0" * 64
    assert store.write(key, b"kept")
    assert store.read(key) == b"kept"
    (file,) = store.path.iterdir()
    for path, mode in ((file, 0o666), (store.path, 0o777), (store.path, 0o730)):
        before = stat.S_IMODE(path.stat().st_mode)
        path.chmod(mode)
        assert store.read(key) is None
        path.chmod(before)
    assert store.read(key) == b"kept"
    # An earlier version left them open: the next file closes them.
    store.path.chmod(0o777)
    store.path.parent.chmod(0o777)
    assert store.write(key, b"again")
    assert store.read(key) == b"again"
    assert {stat.S_IMODE(path.stat().st_mode) for path in (store.path, store.path.parent)} == {
        0o755
    }


@needs_root
def test_cache_of_another_user_ignored(short_folder: Path) -> None:
    short_folder.chmod(0o777)
    code = 'os.makedirs(sys.argv[1]); open(sys.argv[1] + "/" + sys.argv[2], "w"); print("null")'
    folder, key = short_folder / "ergon" / "plans", "0" * 64
    as_second_user(code, folder, f"{key}.json")
    store = CacheFolder(folder, ".json", 10, 1000, 1000)
    assert store.read(key) is None
    assert not store.write(key, b"kept")
    assert (folder / f"{key}.json").read_bytes() == b""
