"""`ergon doctor --hands`: how positions arrive from the inputs of keys without a device."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from commands import records

from ergon import _core
from ergon.cli import app
from ergon.live.boards import Board
from ergon.live.datagrams import encode_message
from ergon.live.hand_arrivals import describe_arrivals

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def sent(port: int, *, seconds: float) -> Iterator[None]:
    """A pointer that sends positions to /x while the block runs, one each `seconds`."""
    over = threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pointer:
            step = 0
            while not over.wait(seconds):
                step += 1
                pointer.sendto(encode_message("/x", [0.01 * (step % 50)]), ("127.0.0.1", port))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_doctor_measures_positions_by_osc(capsys: Capture):
    port = free_port()
    with sent(port, seconds=0.004):
        asked = ["doctor", "--hands", f"osc:/x?port={port}&delay=400ms", "--seconds", "1", "--json"]
        assert app.run(asked) == 0
    (row,) = [record for record in records(capsys) if record["event"] == "hands"]
    assert row["taken"] > 20
    assert row["refused"] == 0
    assert 0.004 <= row["gap_s"] < 0.1
    assert row["gap_s"] <= row["gap_p99_s"] <= row["gap_max_s"]
    assert row["wait_p50_s"] is None, "no message says when it was sent"
    assert row["need_max_s"] >= row["gap_p99_s"]
    assert "positions a second" in row["said"]
    assert "they come early enough for ?delay=" in row["todo"]


def test_doctor_of_unmoved_hand_input(capsys: Capture, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("ergon.api.hand_checks._WAIT_SECONDS_MAX", 0.1)
    assert app.run(["doctor", "--hands", f"osc:/x?port={free_port()}", "--seconds", "0.1"]) == 3
    shown = capsys.readouterr()
    assert "0 positions came, and 20 are needed to measure" in shown.out
    assert "nothing came" in shown.err


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("emul:", "`ergon doctor --device emul:`"),
        ("osc:x", "after osc: comes the address of its messages"),
        ("nonsense", "no device is called nonsense"),
    ],
)
def test_doctor_of_a_wrong_input(capsys: Capture, address: str, words: str):
    assert app.run(["doctor", "--hands", address]) == 2
    assert words in capsys.readouterr().err


def finding(url: str, gaps: list[float], wait: float) -> dict[str, object]:
    """What is said of positions with these gaps [s], each `wait` [s] on its way."""
    lead = _core.Lead(url, finger=(400.0, 2.0, 6e-3), delay=0.02, range=(-0.05, 0.05))
    try:
        begin = lead.now()
        stamp = begin - wait
        for number in range(30):
            stamp += gaps[number % len(gaps)]
            while lead.now() < stamp + wait:
                time.sleep(1e-4)
            assert lead.place(stamp, 0.0)
        result = describe_arrivals(Board(url, ((0, "ada"),)), lead)
    finally:
        lead.close()
    return {"todo": result.advice, "said": result.sentence, **result.numbers}


def test_doctor_of_delayed_positions():
    """A stamped position that is 30 ms on its way needs a delay of that and its gap."""
    row = finding("page:slow", [0.01], 0.03)
    assert row["gap_s"] == pytest.approx(0.01, abs=1e-6)
    assert row["wait_p50_s"] >= 0.03
    assert row["need_max_s"] >= 0.04
    assert "positions come late for its path: ?delay=" in str(row["todo"])
    assert "100 positions a second" in str(row["said"])


def test_doctor_gap_deviation_of_uneven_positions():
    row = finding("page:uneven", [0.006, 0.014], 0.0)
    assert row["gap_s"] == pytest.approx(0.01, rel=0.05)
    assert row["gap_deviation_s"] == pytest.approx(0.004, rel=0.05)
    assert row["gap_p99_s"] == pytest.approx(0.014, abs=0.3e-3)
