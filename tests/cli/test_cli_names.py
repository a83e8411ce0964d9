"""What Tab completes: names by a glance at the text, and scripts that the shells accept."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ERGON

from ergon.cli import app, take
from ergon.cli.names import names_in, names_of

SCORE = """\
ergon: 1
marks: {A: 1|1, B: {odd: 1}, C-2: 9|1}   # on one line
gestures:                                # below each other
  knock: 0mm@0 smooth 6mm@1/8
  # roll: not this one
  lean:
    curve: smooth
    points: |
      # t      x
      0        0mm
  soft: {like: lean}
takes:
    remi-7: {file: takes/hand-7.csv}
players: {ada: {hand: virtual}}
keys:
  k1: {M: 400g}
  k2: {like: k1
"""


def test_names_in_score_by_section() -> None:
    result = names_in(SCORE)
    assert result["marks"] == ["A", "B", "C-2"]
    assert result["gestures"] == ["knock", "lean", "soft"]
    assert result["takes"] == ["remi-7"]
    assert result["players"] == ["ada"]
    assert result["keys"] == ["k1", "k2"]


def test_names_in_text_agree_with_loader(tmp_path: Path) -> None:
    from ergon.scores.reading.load import load

    text = SCORE.replace("B: {odd: 1}", "B: 2|1").replace("k2: {like: k1", "k2: {like: k1}")
    text = text.replace("  k1: {M: 400g}", "  k1: {M: 400g, K: 60N/m, Z: 1Ns/m}")
    text = text.replace("ada: {hand: virtual}", "ada: {hand: virtual, key: k1}")
    (tmp_path / "takes").mkdir()
    (tmp_path / "takes/hand-7.csv").write_text("t [s],x [mm]\n0,0\n0.1,1\n0.2,0\n")
    path = tmp_path / "a.yaml"
    path.write_text(text)
    piece = load(path).piece
    assert piece is not None
    result = names_in(text)
    assert set(result["gestures"]) == set(piece.gestures)
    assert set(result["players"]) == set(piece.players)
    assert set(result["marks"]) == {mark.name for mark in piece.marks}


def test_names_of_missing_and_binary_files_empty(tmp_path: Path) -> None:
    assert names_of(str(tmp_path / "none.yaml"), ("marks",)) == []
    (tmp_path / "x.yaml").write_bytes(bytes(range(256)) * 20)
    assert names_of(str(tmp_path / "x.yaml"), ("marks", "keys")) == []


def test_completion_names_without_heavy_imports(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(SCORE)
    code = (
        "import sys\n"
        "from ergon.cli.app import run\n"
        f"assert run(['completion', '--names', 'gestures,takes', 'bash', {str(path)!r}]) == 0\n"
        "bad = [n for n in ('numpy', 'yaml', 'rich', 'ergon._core') if n in sys.modules]\n"
        "assert not bad, bad\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["knock", "lean", "soft", "remi-7"]


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("scripts")
    built = {}
    for shell in ("bash", "zsh", "fish"):
        command = [*ERGON, "completion", shell]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        built[shell] = folder / f"ergon.{shell}"
        built[shell].write_text(done.stdout)
    return built


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_list_all_commands_and_options(
    scripts: dict[str, Path], shell: str
) -> None:
    text = scripts[shell].read_text()
    for name in app.COMMANDS:
        assert name in text
    for name in take.COMMANDS:
        assert name in text
    for option in ("stems", "simulate", "no-audio", "svg"):
        assert option in text
    if shutil.which(shell):
        subprocess.run([shell, "-n", str(scripts[shell])], check=True)


def complete(script: Path, folder: Path, words: list[str]) -> list[str]:
    """What bash offers for the last of `words`."""
    quoted = " ".join(f"'{word}'" for word in words)
    code = (
        f"ergon() {{ '{sys.executable}' -m ergon.cli \"$@\"; }}\n"
        f"source '{script}'\n"
        f"COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}\n"
        '_ergon; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return sorted(done.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completion_of_commands_and_files(scripts: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SCORE)
    (tmp_path / "a.wav").touch()
    (tmp_path / "a.take").touch()
    (tmp_path / "notes.txt").touch()
    script = scripts["bash"]
    assert complete(script, tmp_path, ["ergon", "ren"]) == ["render"]
    begun = sorted(name for name in app.COMMANDS if name.startswith("co"))
    assert {"compile", "completion"} <= set(begun)
    assert complete(script, tmp_path, ["ergon", "co"]) == begun
    assert complete(script, tmp_path, ["ergon", "check", ""]) == ["a.yaml"]
    assert complete(script, tmp_path, ["ergon", "info", ""]) == ["a.take", "a.wav", "a.yaml"]
    assert complete(script, tmp_path, ["ergon", "take", "tr"]) == ["trim"]
    assert complete(script, tmp_path, ["ergon", "take", "trim", "a.t"]) == ["a.take"]
    assert complete(script, tmp_path, ["ergon", "take", "import", "--au"]) == ["--audio"]
    assert complete(script, tmp_path, ["ergon", "render", "--st"]) == ["--stems", "--strict"]
    assert complete(script, tmp_path, ["ergon", "render", "--bits", ""]) == ["16", "24", "float"]
    assert complete(script, tmp_path, ["ergon", "render", "a.yaml", "--from", ""]) == [
        "A",
        "B",
        "C-2",
    ]
    assert complete(script, tmp_path, ["ergon", "plot", "a.yaml", "k"]) == ["knock"]
    assert complete(script, tmp_path, ["ergon", "plot", "a.yaml", "--key", ""]) == ["k1", "k2"]
