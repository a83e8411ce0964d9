"""What is installed is whole: maturin follows no links and ships no folder unasked."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from documented_cluster import documented_cluster

ROOT = Path(__file__).parents[2]
SHIPPED = {".py", ".pyi", ".yaml", ".csv", ".json", ".md"}
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE", "LICENSE-THIRD-PARTY")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of the checkout; its Rust is compiled already, by the command that installed it."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "maturin", "build", "--release", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


def test_wheel_contains_package_files_only(wheel: Path):
    names = set(zipfile.ZipFile(wheel).namelist())
    parts = ["ergon", "cli", "instruments", "repl", "scores"]
    tracked = subprocess.run(
        ["git", "ls-files", *parts], cwd=ROOT, capture_output=True, check=True, text=True
    ).stdout.split()
    packaged = (f"ergon/{name.removeprefix('ergon/')}" for name in tracked)
    wanted = {name for name in packaged if Path(name).suffix in SHIPPED}
    pages = (ROOT / "docs").glob("**/*.md")
    wanted |= {f"ergon/manual/{page.relative_to(ROOT / 'docs').as_posix()}" for page in pages}
    assert len(wanted) > 80
    assert wanted - names == set()
    assert {"ergon/__init__.py", "ergon/_core.pyi", "ergon/py.typed"} <= names
    # What running leaves in a checkout, such as `.pyc`, does not travel.
    engine = {name for name in names if Path(name).suffix in {".so", ".pyd"}}
    assert len(engine) == 1
    inside = {name for name in names if name.startswith("ergon/")} - engine
    assert not [name for name in inside if name.startswith("ergon/manual/generators/")]
    assert {Path(name).suffix for name in inside} <= SHIPPED | {".typed"}


def test_wheel_contains_licences(wheel: Path):
    with zipfile.ZipFile(wheel) as files:
        result = {Path(name).name: name for name in files.namelist() if "/licenses/" in name}
        assert set(LICENCES) <= set(result)
        for name in LICENCES:
            assert files.read(result[name]) == (ROOT / name).read_bytes()


def test_third_party_licences_list_linked_crates():
    """`make docs` makes the file anew."""
    command = ["cargo", "tree", "--locked", "-p", "ergon-bridge", "--prefix", "none"]
    command += ["-e", "normal,no-proc-macro"]
    output = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    crates = {line.removesuffix(" (*)") for line in output.splitlines()}
    crates = {line.replace(" v", " ", 1) for line in crates if "(" not in line}
    assert len(crates) > 40
    text = (ROOT / "LICENSE-THIRD-PARTY").read_text(encoding="utf-8")
    listed = {line.partition(":")[0] for line in text.splitlines()}
    assert crates - listed == set()
    # The one licence among them that asks where the source is.
    assert "Mozilla Public License, v. 2.0" in text
    assert "https://crates.io/crates/" in text


def test_wheel_renders_without_checkout(wheel: Path, tmp_path: Path):
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


@pytest.mark.slow
def test_sdist_builds_same_wheel(wheel: Path, tmp_path: Path):
    command = [sys.executable, "-m", "maturin", "sdist", "--out", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (source,) = tmp_path.glob("*.tar.gz")
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation"]
    build += ["--wheel-dir", str(tmp_path / "made"), str(source)]
    single = {**os.environ, "CARGO_TARGET_DIR": str(ROOT / "target")}
    single["PATH"] = (
        f"{Path(sys.executable).parent}{os.pathsep}{single['PATH']}"  # pip calls maturin
    )
    single.pop("PYTHONPATH", None)
    done = subprocess.run(build, cwd=tmp_path, capture_output=True, text=True, env=single)
    assert done.returncode == 0, done.stderr[-3000:]
    (built,) = (tmp_path / "made").glob("*.whl")
    with zipfile.ZipFile(wheel) as first, zipfile.ZipFile(built) as two:
        assert set(first.namelist()) == set(two.namelist())
        for name in first.namelist():
            if name.startswith("ergon/") and name.endswith(tuple(SHIPPED)):
                assert first.read(name) == two.read(name), name


@pytest.mark.slow
def test_wheel_with_cluster_in_clean_environment(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A clean environment, without Rust and checkout; the documented commands; the same bytes."""
    binaries = tmp_path / "venv" / "bin"
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "venv")], check=True)
    install = [str(binaries / "pip"), "install", "--quiet", f"{wheel}[cluster]"]
    done = subprocess.run(install, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"what ergon needs cannot be had: {done.stderr.strip().splitlines()[-1]}")
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    environment = {
        "PATH": f"{binaries}{os.pathsep}/usr/bin{os.pathsep}/bin",
        "ERGON_CACHE": "plans",
    }
    environment |= {"HOME": str(tmp_path), "PYTHONPATH": "", "XDG_CACHE_HOME": str(tmp_path / "c")}
    single = {**os.environ, **environment}

    def output(line: str) -> str:
        done = subprocess.run(line, shell=True, env=single, capture_output=True, text=True)
        assert done.returncode == 0, f"{line}: {done.stderr}"
        return done.stdout + done.stderr

    where = output("python -c 'import ergon; print(ergon.__path__[0])'").strip()
    assert where.startswith(str(tmp_path))
    piece = f"{where}/scores/library/feathers-small.yaml --to 4s"
    with documented_cluster("A cluster", environment) as cluster:
        assert len(cluster.processes) == 3
        plan, render = cluster.you
        output(f"ergon render {piece} -o one.wav")
        assert "on 2 workers: " in output(
            plan.replace("piece.yaml", piece.removesuffix(" --to 4s"))
        )
        printed = output(render.replace("piece.yaml", f"{piece} -o two.wav"))
        assert printed.count("worker ") == 2
    assert Path("two.wav").read_bytes() == Path("one.wav").read_bytes()
    assert Path("one.wav").stat().st_size > 100_000
    output("pip uninstall --yes --quiet ergon-live")
    assert not Path(where).exists()
