"""What is installed is whole: maturin follows no links and ships no folder unasked."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHIPPED = {".py", ".yaml", ".csv", ".json", ".md"}
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE", "LICENSE-THIRD-PARTY")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of the checkout; its Rust is compiled already, by the command that installed it."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "maturin", "build", "--release", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def test_the_wheel_holds_every_part_and_nothing_else(wheel: Path):
    names = set(zipfile.ZipFile(wheel).namelist())
    package = ROOT / "core-rs" / "python" / "ergon"
    parts = [link.name for link in package.iterdir() if (ROOT / link.name).is_dir()]
    tracked = subprocess.run(
        ["git", "ls-files", *parts], cwd=ROOT, capture_output=True, check=True, text=True
    ).stdout.split()
    wanted = {f"ergon/{name}" for name in tracked if Path(name).suffix in SHIPPED}
    assert len(wanted) > 80
    assert wanted - names == set()
    assert {"ergon/__init__.py", "ergon/_core.pyi", "ergon/py.typed"} <= names
    # What running leaves in a checkout, such as `.pyc`, does not travel.
    engine = {name for name in names if Path(name).suffix in {".so", ".pyd"}}
    assert len(engine) == 1
    inside = {name for name in names if name.startswith("ergon/")} - engine
    assert {Path(name).suffix for name in inside} <= SHIPPED | {".pyi", ".typed"}


def test_the_wheel_holds_the_licences_of_what_is_linked_in(wheel: Path):
    with zipfile.ZipFile(wheel) as files:
        found = {Path(name).name: name for name in files.namelist() if "/licenses/" in name}
        assert set(LICENCES) <= set(found)
        for name in LICENCES:
            assert files.read(found[name]) == (ROOT / name).read_bytes()


def test_every_crate_that_is_linked_in_is_named():
    """`make docs` makes the file anew."""
    command = ["cargo", "tree", "--locked", "-p", "ergon-bridge", "--prefix", "none"]
    command += ["-e", "normal,no-proc-macro"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    crates = {line.removesuffix(" (*)") for line in told.splitlines()}
    crates = {line.replace(" v", " ", 1) for line in crates if "(" not in line}
    assert len(crates) > 40
    text = (ROOT / "LICENSE-THIRD-PARTY").read_text(encoding="utf-8")
    listed = {line.partition(":")[0] for line in text.splitlines()}
    assert crates - listed == set()
    # The one licence among them that asks where the source is.
    assert "Mozilla Public License, v. 2.0" in text
    assert "https://crates.io/crates/" in text


def test_the_installed_wheel_renders(wheel: Path, tmp_path: Path):
    """Unpacked alone, with nothing of the checkout in reach."""
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    code = f"""
import sys
sys.path.insert(0, {str(site)!r})
import ergon
assert ergon.__file__.startswith({str(site)!r}), ergon.__file__
from ergon.cli.app import main
main()
"""
    arguments = ["demo", "--no-audio", "-o", str(tmp_path / "demo.wav")]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "demo.wav").stat().st_size > 100_000
