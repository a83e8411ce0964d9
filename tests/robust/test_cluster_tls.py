"""TLS by the commands of docs/cluster.md; certificates that lack are told of by a sentence."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ERGON
from documented_cluster import documented_cluster
from needed import needs

from ergon.cli import app

pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

SCORE = """\
ergon: 1
rates: {audio: 8000Hz}
accuracy: {method: ca}
instruments:
  a: {modules: {p: {PLATE: {shape: hex, radius: 5, M: 50g, f: 300Hz, t60: 1s,
    hardening: 1e9N/m3}}}, out: {x: {SOX: p.3}}}
strikes: {s: {to: [a.p.centre], at: 0.1s, impulse: 1mNs}}
render: {tail: 1s, bits: float}
"""
TLS = "DASK_DISTRIBUTED__COMM__TLS__"


@pytest.fixture(autouse=True)
def here(work_folder: Path) -> None:
    Path("piece.yaml").write_text(SCORE)


@needs("openssl")
@pytest.mark.slow
def test_cluster_tls_by_documented_commands():
    binaries = Path(sys.executable).parent
    if not (binaries / "dask").exists():
        pytest.skip("no command dask")
    environment = {"PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}", "ERGON_CACHE": "plans"}
    single = {**os.environ, **environment}
    words = [*ERGON, "render", "piece.yaml", "-o", "one.wav", "-q"]
    assert subprocess.run(words, env=single).returncode == 0
    with documented_cluster("Where the network is not trusted", environment) as cluster:
        *settings, render = cluster.you
        assert [line.split("=")[0] for line in settings] == [
            f"export {TLS}{name}" for name in ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
        ]
        assert render.startswith("ergon render piece.yaml --on tls://")
        render = render.replace("ergon", " ".join(ERGON), 1)
        done = subprocess.run(
            "\n".join((*settings, render)), shell=True, env=single, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert "worker " in done.stderr
        assert Path("piece.wav").read_bytes() == Path("one.wav").read_bytes()
        # Nobody without a certificate of that authority.
        stranger = "openssl req -x509 -newkey rsa:2048 -nodes -subj /CN=x -keyout x.key -out x.pem"
        subprocess.run(stranger.split(), check=True, capture_output=True)
        theirs = [settings[0], *(line.replace("node.", "x.") for line in settings[1:])]
        plain = render.replace("tls://", "tcp://")
        for lines in ([*theirs, render], [plain]):
            done = subprocess.run(
                "\n".join(lines), shell=True, env=single, capture_output=True, text=True
            )
            assert done.returncode == 2
            assert "no scheduler answers" in done.stderr


@pytest.mark.parametrize(
    ("names", "output"),
    [
        ({}, "names no certificates; set DASK_DISTRIBUTED__COMM__TLS__CA_FILE"),
        ({"CA_FILE": "piece.yaml"}, "names no certificates"),
        ({"CA_FILE": "no.pem", "CLIENT__CERT": "no.pem"}, "cannot be used: "),
        ({"CA_FILE": "piece.yaml", "CLIENT__CERT": "piece.yaml"}, "cannot be used: "),
    ],
)
def test_cluster_tls_missing_certificates_message(
    names: dict[str, str], output: str, capsys: pytest.CaptureFixture[str]
):
    import dask.config

    names = {"CA_FILE": "", "CLIENT__CERT": "", "CLIENT__KEY": "", **names}
    keys = {f"distributed.comm.tls.{n.lower().replace('__', '.').replace('_', '-')}": value
            for n, value in names.items()}  # fmt: skip
    with dask.config.set({key: value or None for key, value in keys.items()}):
        assert app.run(["render", "piece.yaml", "--on", "tls://127.0.0.1:1", "-o", "x.wav"]) == 2
    assert output in capsys.readouterr().err
    assert not Path("x.wav").exists()
