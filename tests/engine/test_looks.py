"""Whatever is computed of a large body, Ctrl-C is looked for soon.

Soon is meant in processor time, which a busy machine does not change.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from commands import ERGON
from patience import until
from sweep import few

_SUPPORT = Path(__file__).parents[1] / "support"
# Each is long in another place of Rust or Python.
_LOOKS = {
    "plan": "plan score.yaml",
    "check": "check score.yaml",
    "modes": "modes score.yaml",
    "stats": "stats score.yaml --upto 2Hz",
    "admittance": "admittance score.yaml s.0",
    "info": "info score.yaml",
}
_BODIES = {
    "string": "STRING: {{masses: {n}, M: 1kg, f: 2Hz, t60: 9s}}",
    "hardening": "STRING: {{masses: {n}, M: 1kg, f: 2Hz, t60: 9s, hardening: 4e8N/m3}}",
    "bank": "BANK: {{count: {n}, M: 1g, f: 50Hz..8kHz, t60: 1s..3s}}",
}
_SCORE = """\
ergon: 1
instruments:
  s:
    {body}
    out: {{SOX: s.centre}}
strikes: {{h: {{to: s.centre, at: 0, impulse: 1mNs}}}}
render: {{tail: 2s}}
"""


def _longest_stretch(folder: Path, body: str, n: int, command: str, limit: float) -> float:
    """The longest processor time without a look, in a command of at most `limit` [s] of it [s]."""
    text = _SCORE.format(body=_BODIES[body].format(n=n))
    (folder / "score.yaml").write_text(text, encoding="utf-8")
    line = [sys.executable, str(_SUPPORT / "looks.py"), str(limit), *_LOOKS[command].split()]
    environment = {**os.environ, "ERGON_CACHE": "off"}
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    longest, where = json.loads(done.stdout.splitlines()[-1])
    assert "Traceback" not in done.stderr, where
    return float(longest)


@pytest.mark.parametrize("command", few(_LOOKS, ["plan"]))
def test_control_c_is_looked_for_in_a_large_body(command: str, tmp_path: Path):
    assert _longest_stretch(tmp_path, "string", 100_000, command, 4.0) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("body", _BODIES)
@pytest.mark.parametrize("command", _LOOKS)
def test_control_c_is_looked_for_in_the_largest_body(command: str, body: str, tmp_path: Path):
    """What passes over all masses once takes up to a fifth of a second."""
    assert _longest_stretch(tmp_path, body, 2_000_000, command, 40.0) < 1.0


def _used(child: int) -> float:
    """Processor time of a process [s]."""
    output = Path(f"/proc/{child}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(output[11]) + int(output[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
@pytest.mark.parametrize("more", few(["", "--threads 1", "--method ca"], [""]))
def test_control_c_ends_a_render_of_a_large_body(more: str, tmp_path: Path):
    """It went on for 64 s of processor time: only the thread that waited for others looked."""
    text = _SCORE.format(body=_BODIES["string"].format(n=200_000))
    (tmp_path / "score.yaml").write_text(text, encoding="utf-8")
    line = [*ERGON, "render", "score.yaml", "-o", "out.wav", "-f", *more.split()]
    environment = {**os.environ, "ERGON_CACHE": "off"}
    child = subprocess.Popen(line, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL)
    try:
        # The plan takes half of it.
        until(lambda: _used(child.pid) > 4.0, "frames computed")
        before = _used(child.pid)
        child.send_signal(signal.SIGINT)
        _, status, used = os.wait4(child.pid, 0)
    finally:
        child.kill()
    assert os.waitstatus_to_exitcode(status) == 130
    assert used.ru_utime + used.ru_stime - before < 1.0
    assert [path.name for path in tmp_path.iterdir()] == ["score.yaml"]
