"""How ergon is installed: versions that agree, pages that name what exists, a whole release."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import requires
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from ergon.common import extras

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CARGO = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]
NUMBER = CARGO["package"]["version"]


def test_version_numbers_agree_in_all_parts():
    crates = {
        name: table["version"] for name, table in CARGO["dependencies"].items() if "path" in table
    }
    assert len(crates) == 3
    assert set(crates.values()) == {NUMBER}
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text(encoding="utf-8"))
    locked = {one["name"]: one["version"] for one in lock["package"] if "source" not in one}
    assert {name for name in locked if name.startswith("ergon-")} >= {*crates, "ergon-bridge"}
    assert {version for name, version in locked.items() if name.startswith("ergon-")} == {NUMBER}
    extension = json.loads((ROOT / "editors/vscode/package.json").read_text(encoding="utf-8"))
    assert extension["version"] == NUMBER
    assert "version" in PROJECT["dynamic"]  # that of Cargo.toml


def test_changelog_newest_release_is_current_version():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, *releases = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert unreleased.startswith("[Unreleased]\n")
    assert re.match(rf"\[{re.escape(NUMBER)}\] - \d{{4}}-\d\d-\d\d\n", releases[0])
    for release in releases:
        assert len(release.splitlines()) <= 60
    assert re.findall(r"^### (.+)", releases[0], re.MULTILINE)[0] == "What breaks"


def pages() -> list[Path]:
    folders = ("", "docs", "docs/howto", "docs/design", "editors", "examples")
    return [page for name in folders for page in sorted((ROOT / name).glob("*.md"))]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_pages_install_without_package_index(page: Path):
    """Until ergon-live is published, what brings it is a checkout or the file of a wheel."""
    text = page.read_text(encoding="utf-8")
    for command in re.findall(r"(?:pip|pipx|uv pip|uvx)\s+(?:install|run)\s+[^`\n]*", text):
        assert not re.search(r"(?<![./\w])'?ergon-live\b", command), f"{page.name}: {command}"
    if page.name != "install.md":
        assert "pip install ergon" not in text


def test_install_page_table_of_extras():
    text = (ROOT / "docs/install.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| ([\w, -]+) \|", text, re.MULTILINE))
    listed = {
        extra: [Requirement(line).name for line in lines]
        for extra, lines in PROJECT["optional-dependencies"].items()
    }
    assert {extra: names.split(", ") for extra, names in rows.items()} == listed


def test_install_command_of_extra_from_wheel(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(extras, "_is_clone", lambda folder: False)
    words = extras.install_command("cluster").removeprefix("pip install ")
    wanted = [line for line in requires("ergon-live") or [] if "cluster" in line]
    assert len(wanted) == 2
    assert words == " ".join(f"'{line.partition(';')[0].strip()}'" for line in wanted)
    assert "ergon-live" not in words


def test_entry_points_of_both_command_names_equal():
    assert PROJECT["scripts"]["ergon"] == PROJECT["scripts"][PROJECT["name"]]


def test_release_workflow_installs_built_wheels():
    text = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    wheels = jobs["wheels"]["strategy"]["matrix"]["include"]
    kinds = {(one["os"].partition("-")[0], one["manylinux"]) for one in wheels}
    assert kinds >= {("ubuntu", "2_28"), ("ubuntu", "musllinux_1_2"), ("macos", "off")}
    assert {one["target"] for one in wheels} == {"x86_64", "aarch64"}
    # A wheel goes out only after the demo sounded from it, and after every job before.
    assert set(jobs["publish"]["needs"]) == set(jobs) - {"publish"}
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert "ergon demo" in json.dumps(jobs["installed"])
    # The wheel of Windows may be missing, and goes out only if it played.
    assert jobs["windows"]["continue-on-error"] is True
    steps = [json.dumps(step) for step in jobs["windows"]["steps"]]
    played = next(i for i, step in enumerate(steps) if "ergon demo" in step)
    assert "upload-artifact" in steps[-1]
    assert played == len(steps) - 2
    assert "secrets." not in text


def test_musllinux_wheel_without_numba_requirement():
    """What the workflow runs before such a wheel is built takes out this line alone."""
    text = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    (pattern,) = re.findall(r"sed -i '/(.+)/d' pyproject\.toml", text)
    lines = (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
    gone = [line for line in lines if re.search(pattern, line)]
    assert [Requirement(line.strip(' ",')).name for line in gone] == ["numba"]


@pytest.mark.skipif(sys.platform == "win32", reason="make")
def test_make_wheel_finds_zig_without_an_activated_environment():
    """maturin asks the first `python3` on the PATH for zig; a venv of the wheel's holds both."""
    command = ["make", "--dry-run", "wheel"]
    plain = {**os.environ, "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=plain, check=True)
    line = next(line for line in done.stdout.splitlines() if "maturin build" in line)
    assert line.startswith(f'PATH="{ROOT}/.venv-wheel/bin:$PATH" ')
    assert "--editable" not in done.stdout  # a wheel needs no build of the package before it


def test_commit_of_wheel_without_compiled_core(tmp_path: Path):
    """`make wheel` calls it in a fresh clone, where nothing is compiled yet."""
    blocked = tmp_path / "ergon_core_blocked.py"
    blocked.write_text("import sys\nsys.modules['ergon._core'] = None\n")
    record = tmp_path / "build.json"
    code = (
        "import ergon_core_blocked, runpy, sys\n"
        f"sys.argv = ['build_record', {str(record)!r}]\n"
        "runpy.run_module('docs.generators.build_record', run_name='__main__', alter_sys=True)"
    )
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    subprocess.run([sys.executable, "-S", "-c", code], check=True, env=environment, cwd=tmp_path)
    assert re.fullmatch(r"[0-9a-f]{8}\+?", json.loads(record.read_text())["commit"])
