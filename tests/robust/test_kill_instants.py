"""kill -9 at every change of a file: what is there is whole, and the next run makes the rest.

Between two changes of names a kill changes nothing but what is in temporary files, so these are all
instants that differ. Kills at random instants, of takes and sessions too, are in `test_kills.py`.
"""

import shutil
import signal
from pathlib import Path

import pytest
from commands import forked
from sweep import few
from writing_commands import MAKERS, WRITERS, Writer, contents, make_inputs, writers_of

EVERY = (*MAKERS, *WRITERS)
SHOWN = writers_of("new piece", "export s.yaml --to faust")
# They hold times of the processor, so no two are alike.
_TIMED = ("sweep.csv", "sweep.svg", "c.csv", "c.svg", "c.png")
_CHANGES_MAX = 200  # changes of a file


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


def run(writer: Writer, folder: Path, killed_at: int = 0) -> int:
    done = forked([*writer.words, "-q"], folder, killed_at=killed_at)
    assert not done.stderr, done.stderr
    return done.returncode


def temporary(name: str) -> bool:
    return any(part.endswith(".part") for part in name.split("/"))


def alike(outcome: dict[str, bytes], wanted: dict[str, bytes]) -> bool:
    return outcome.keys() == wanted.keys() and all(
        outcome[name] == wanted[name] for name in outcome if not name.endswith(_TIMED)
    )


@pytest.mark.parametrize("writer", few(EVERY, SHOWN), ids=lambda writer: writer.line)
def test_kill_at_each_file_change_leaves_valid_files(
    inputs: Path, tmp_path: Path, writer: Writer
) -> None:
    complete = shutil.copytree(inputs, tmp_path / "whole")
    before = contents(complete)
    assert run(writer, complete) == 0
    built = contents(complete)
    assert built.keys() - before.keys() == {*writer.files}
    is_maker = writer in MAKERS
    for is_over in (False,) if is_maker else (False, True):
        for number in range(1, _CHANGES_MAX):
            folder = shutil.copytree(
                complete if is_over else inputs, tmp_path / f"{is_over}{number}"
            )
            code = run(writer, folder, number)
            left = {name: data for name, data in contents(folder).items() if not temporary(name)}
            if is_maker:
                assert alike(left, before) or alike(left, built), "part of a folder"
            for name, data in left.items():
                assert name.endswith(_TIMED) or data == built[name], f"{name}, change {number}"
            if code == 0:
                break
            assert code == -signal.SIGKILL
            if not (is_maker and alike(left, built)):
                assert run(writer, folder) == 0, f"it does not go on after change {number}"
            assert alike(contents(folder), built), f"litter after change {number}"
            shutil.rmtree(folder)
        assert 3 < number < _CHANGES_MAX - 1, "no kill was tried"
