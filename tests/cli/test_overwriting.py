"""One rule for every command that writes: what is as ergon wrote it is overwritten unasked, and
nothing else.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from commands import forked
from sweep import few
from writing_commands import WRITERS, Writer, contents, make_inputs, writers_of

from ergon.cli.app import group
from ergon.cli.lazy import LazyGroup

SHOWN = writers_of("render s.yaml -o x.wav --s", "plan", "admittance", "export s.yaml --to faust",
                   "layout import")  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


@pytest.fixture
def folder(inputs: Path, tmp_path: Path) -> Path:
    return shutil.copytree(inputs, tmp_path / "here")


def run(writer: Writer, folder: Path, *more: str) -> tuple[int, str]:
    done = forked([*writer.words, "-q", *more], folder)
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    return done.returncode, done.stderr


@pytest.mark.parametrize("writer", few(WRITERS, SHOWN), ids=lambda writer: writer.line)
def test_overwriting_an_edited_output_needs_f(folder: Path, writer: Writer) -> None:
    before = contents(folder)
    assert run(writer, folder) == (0, "")
    assert contents(folder).keys() - before.keys() == {*writer.files}
    assert run(writer, folder) == (0, "")
    built = contents(folder)
    for name in writer.files:
        edited = bytearray(built[name])
        edited[len(edited) // 2] ^= 1
        (folder / name).write_bytes(edited)
        code, output = run(writer, folder)
        assert code == 2, name
        assert "-f overwrites it" in output
        assert name in output
        assert contents(folder) == built | {name: bytes(edited)}
        (folder / name).write_bytes(built[name])
    (folder / writer.files[-1]).write_bytes(edited)
    assert run(writer, folder, "-f") == (0, "")
    assert contents(folder)[writer.files[-1]] != edited


# Tested elsewhere: tests/view/test_movie.py, tests/cli/test_cli_metrology.py, and what hands did
# below.
OTHERS = {"view", "metrology measure", "metrology fit", "metrology replay", "take trim",
          "take import"}  # fmt: skip


def test_force_table_covers_all_commands_with_f() -> None:
    """A command that begins to write files is added to the table."""
    tried = {" ".join(writer.words[:count]) for writer in WRITERS for count in (1, 2)}
    assert {*with_force(group, "")} - tried == OTHERS


def with_force(command: click.Command, name: str) -> Iterator[str]:
    """The names of commands that have an option -f."""
    if isinstance(command, LazyGroup):
        context = click.Context(command)
        for item in command.list_commands(context):
            inner = command.get_command(context, item)
            assert inner is not None
            yield from with_force(inner, f"{name} {item}".strip())
    elif any("--force" in parameter.opts for parameter in command.params):
        yield name


@pytest.mark.parametrize(
    "line", ["take import in.csv -o n.take", "take trim in.take 10ms 50ms -o n.take"]
)
def test_take_files_overwritten_only_with_f(folder: Path, line: str) -> None:
    (folder / "in.csv").write_text("t [s],x [m]\n0,0\n0.1,0.001\n0.2,0\n")
    writer = Writer(line, ("n.take",))
    assert run(writer, folder) == (0, "")
    code, output = run(writer, folder)
    assert (code, "n.take exists; -f overwrites it" in output) == (2, True)
    assert run(writer, folder, "-f")[0] == 0


@pytest.mark.parametrize("line", ["fmt s.yaml", "tune s.yaml bell A4 --write"])
def test_import_over_formatted_score_needs_f(folder: Path, line: str) -> None:
    score = folder / "s.yaml"
    score.write_text(score.read_text().replace("{channels: 2,", "{  channels: 2,"))
    assert run(Writer(line, ("s.yaml",)), folder) == (0, "")
    laid_out = score.read_text()
    code, output = run(Writer("import in.mdl -o s.yaml", ("s.yaml",)), folder)
    assert (code, "-f overwrites it" in output) == (2, True)
    assert score.read_text() == laid_out
