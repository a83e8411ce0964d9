"""What tests need and a machine may lack: installed, or skipped and named."""

import io
from pathlib import Path

import needed
import programs
import pytest


@pytest.fixture
def bare_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder in which programs are searched; nothing is in it."""
    monkeypatch.setenv("PATH", str(tmp_path))
    return tmp_path


def put_program(folder: Path, name: str, text: str = "") -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def report(outcome: str, reason: str, name: str = "tests/a.py::test_b[c]") -> pytest.TestReport:
    place = ("tests/a.py", 1, f"Skipped: {reason}")
    return pytest.TestReport(name, ("tests/a.py", 1, "b"), {}, outcome, place, "setup")


def test_programs_missing_and_install_hint(bare_path: Path) -> None:
    assert programs.missing("jackd", "vim") == ["jackd", "vim"]
    assert programs.missing() == list(programs.PACKAGES)
    assert programs.remedy(["vim", "jackd"]) == "apt-get install jackd2 vim"
    put_program(bare_path, "google-chrome")
    assert programs.missing("chromium") == []


def test_programs_install_without_apt(bare_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    programs.main()
    output = capsys.readouterr().out.splitlines()
    assert output[0].startswith(
        "tests use programs that are missing here: apt-get install chromium "
    )
    assert output[1:] == [
        "not installed (there is no apt-get here); the tests that need them are skipped"
    ]


@pytest.mark.parametrize(("code", "why"), [(0, ""), (100, "apt-get ended with 100")])
def test_programs_install_by_apt(
    bare_path: Path, monkeypatch: pytest.MonkeyPatch, code: int, why: str
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 0)
    for name in ("env", "flock", "sh"):
        (bare_path / name).symlink_to(f"/usr/bin/{name}")
    put_program(bare_path, "apt-get", f'echo "$@" >> {bare_path}/asked; exit {code}')
    assert programs.install(["vim"]) == why
    asked = ["update -qq", "install vim --yes -qq --no-install-recommends"]
    assert (bare_path / "asked").read_text().splitlines() == (asked[:1] if code else asked)


def test_programs_install_without_password(
    bare_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    put_program(bare_path, "apt-get")
    assert programs.install(["vim"]) == "only root or sudo may install packages"
    put_program(bare_path, "sudo", '[ "$1" = -n ] && exit 1')
    assert programs.install(["vim"]) == "apt-get ended with 1"


def test_skipped_tests_are_named_by_their_reason(bare_path: Path) -> None:
    with pytest.raises(pytest.skip.Exception, match="vim missing: apt-get install vim"):
        needed.program("vim")
    reports = [report("skipped", "x"), report("skipped", "x", "tests/a.py::test_a"),
               report("skipped", "w")]  # fmt: skip
    assert needed.skipped_lines(reports) == [
        "w", "    tests/a.py::test_b", "x", "    tests/a.py::test_a", "    tests/a.py::test_b",
    ]  # fmt: skip


def test_skipped_test_reported_as_failure() -> None:
    skipped, passed = report("skipped", "no disk"), report("passed", "")
    expected = report("skipped", "not yet")
    expected.wasxfail = "reason: not yet"
    for item in (skipped, passed, expected):
        needed.as_failure(item)
    assert [item.outcome for item in (skipped, passed, expected)] == ["failed", "passed", "skipped"]
    assert "no disk" in str(skipped.longrepr)
