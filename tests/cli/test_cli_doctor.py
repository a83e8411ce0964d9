"""`ergon doctor`, `ergon devices` and `ergon take record`, with devices that are emulated."""

import json
import math
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from boards import Board, emulated
from commands import records
from emulators import pulled
from patience import PATIENCE, until
from sweep import few

from benches.interrupts import CHILD
from docs.generators import faults
from ergon import _core
from ergon.cli import app
from ergon.live import fitness, ports
from ergon.live.faults import FaultResult, FaultRow
from ergon.scores.gesture import notation
from ergon.scores.gesture.sampled import sampled_positions

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("NO_COLOR", "1")
    return tmp_path


def by(found: list[dict], event: str) -> dict:
    (record,) = (record for record in found if record["event"] == event)
    return record


@pytest.mark.parametrize("clock", few([(), ("--lockstep",)], 1))
def test_doctor_measures_every_tick_and_every_reply(capsys: Capture, clock: tuple[str, ...]):
    with emulated("frame", "--udp", "0", *clock) as url:
        asked = ["doctor", "--no-audio", "--seconds", "0.5", "--json", "--device", url]
        assert app.run(asked) == 0
    rows = records(capsys)
    assert [r["event"] for r in rows] == [
        *("machine", "speed", "laws", "thread", "memory", "wake-up", "device", "felt")
    ]
    wakes, device, forces = (by(rows, what) for what in ("wake-up", "device", "felt"))
    n = math.ceil(0.5 / fitness.TICK_SECONDS)
    assert wakes["ticks"] == sum(wakes["histogram_us"]) == n
    assert 0 < wakes["p50_s"] <= wakes["p99_s"] <= wakes["p999_s"] <= wakes["max_s"]
    assert device["asked"] == device["unanswered"] + sum(device["histogram_us"]) == n
    # A datagram there and back takes some microseconds at least; most come within 20 ms, or none.
    assert 1e-6 < device["p50_s"] < 0.1
    assert device["p50_s"] <= device["max_s"]
    assert forces["felt_p50_s"] == pytest.approx(44 / 44100 + device["p50_s"])
    if clock:
        assert device["unanswered"] == 0
    policy = by(rows, "thread")
    assert (policy["fifo"] is None) == bool(policy["todo"])


def test_doctor_with_ticks_up_to_the_audio_rate(capsys: Capture):
    """In lockstep every reply comes before the next tick begins, however short it is."""
    with emulated("frame", "--udp", "0", "--lockstep") as url:
        asked = ["doctor", "--ticks", "--seconds", "0.2", "--json", "--device", url]
        assert app.run(asked) == 0
    rows = records(capsys)
    assert [r["event"] for r in rows] == ["tick"] * 6 + ["shortest"]
    for row, frames in zip(rows, (44, 22, 11, 5, 2, 1), strict=False):
        assert row["tick_hz"] == pytest.approx(44100 / frames)
        assert row["asked"] == math.ceil(0.2 * 44100 / frames)
        assert row["felt_p50_s"] > frames / 44100
        assert row["felt_p99_s"] >= row["felt_p50_s"]
        assert row["load"] > 0.0
        few_late = max(row["late_ticks"], row["late_replies"]) <= 1e-3 * row["asked"]
        assert row["fits"] is few_late
    fitting = [row["tick_hz"] for row in rows[:-1] if row["fits"]]
    assert rows[-1]["tick_hz"] == (fitting[-1] if fitting else None)
    assert app.run(["doctor", "--ticks"]) == 2


def test_doctor_with_missing_devices(capsys: Capture):
    asked = ["doctor", "--audio", "null", "--seconds", "0.1"]
    assert app.run([*asked, "--device", "frame:/dev/nowhere", "--device", "emul:"]) == 3
    output = capsys.readouterr()
    assert "frame:/dev/nowhere" in output.err
    assert "emul:: p50" in output.out
    assert "no server answers" in output.out
    assert app.run([*asked, "--device", "nobody"]) == 2


def test_doctor_sound_backend_advice(capsys: Capture):
    asked = ["doctor", "--audio", "jack:nobody-here", "--seconds", "0.1", "--json"]
    assert app.run(asked) == 0
    sound = by(records(capsys), "sound")
    assert sound["backend"] in (None, "jack")
    assert sound["backend"] == "jack" or "file:" in sound["todo"]


def test_doctor_quantiles_and_histogram():
    seconds = np.array([1, 2, 3, 4, 900, 1500]) * 1e-6
    assert fitness.quantile(seconds, 0.5) == pytest.approx(4e-6)
    assert fitness.quantiles_text(seconds).endswith("p99 1.50 ms, p99.9 1.50 ms, longest 1.50 ms")
    bins = fitness.histogram(seconds)["histogram_us"]
    # 1; 2 and 3; 4; 512 to 1023; 1024 to 2047 µs.
    assert [(i, n) for i, n in enumerate(bins) if n] == [(1, 1), (2, 2), (3, 1), (10, 1), (11, 1)]
    assert math.isnan(fitness.quantile(np.zeros(0), 0.5))


def test_ftdi_latency_timer_value(tmp_path: Path):
    timer = tmp_path / "ttyUSB0/latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    assert ports.latency_timer("firefader:/dev/ttyUSB0?lockstep", tmp_path) == 16
    assert ports.latency_timer("firefader:/dev/ttyACM0", tmp_path) is None
    assert ports.latency_timer("emul:", tmp_path) is None


def port(path: str, vendor: int | None = None, name: str = "", serial: str = "") -> object:
    """A serial port as the core lists it."""
    usb = SimpleNamespace(vendor=vendor, product=0, name=name, serial=serial)
    return SimpleNamespace(path=path, usb=None if vendor is None else usb)


def test_devices_lists_sound_names_and_ports(
    folder: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
):
    config = folder / "config/ergon/devices.toml"
    config.parent.mkdir(parents=True)
    config.write_text(
        '[devices]\nleft = "firefader:/dev/ttyACM0#1"\n[calibration."firefader:/dev/ttyACM0#1"]\n'
        "sign = 1\nzero = 0.0\ngain = 1.0\nrange = [-0.03, 0.03]\nforce_max = 1.5\n"
    )
    plugged = [
        port("/dev/ttyACM0", 0x16C0, "USB Serial", "77"),
        port("/dev/ttyS0"),
        port("/dev/ttyUSB0", 0x0403, "FT232R"),
    ]
    monkeypatch.setattr(_core, "serial_ports", lambda: plugged)
    monkeypatch.setattr(ports, "SERIAL_LINKS_FOLDER", folder / "by-id")
    (folder / "by-id").mkdir()
    (folder / "by-id/usb-Teensy_77").symlink_to("/dev/ttyACM0")
    assert app.run(["devices", "--json"]) == 0
    rows = records(capsys)
    assert {r["audio"] for r in rows if r["event"] == "sound"} >= {"jack", "pulse"}
    assert by(rows, "device") == {
        **{"v": 1, "event": "device", "name": "left", "url": "firefader:/dev/ttyACM0#1"},
        "tested": [1],
        "uses": ["force"],
    }
    assert [row["uses"] for row in rows if row["event"] == "port"] == [["force"], [], ["force"]]
    hands = {row["kind"]: row["uses"] for row in rows if row["event"] == "hand"}
    assert hands["page"] == hands["keys"] == ["hand"]
    assert hands["osc"] == hands["midi"] == ["input", "hand"]
    assert [(r["path"], r["name"], r["urls"]) for r in rows if r["event"] == "port"] == [
        ("/dev/ttyACM0", "Teensy USB Serial 77", [f"frame:{folder}/by-id/usb-Teensy_77"]),
        ("/dev/ttyS0", "", []),
        ("/dev/ttyUSB0", "FTDI FT232R", ["firefader:/dev/ttyUSB0"]),
    ]
    assert app.run(["devices"]) == 0
    assert "left         firefader:/dev/ttyACM0#1  force (axis 1 tested)" in capsys.readouterr().out


def test_devices_probes_only_when_asked(capsys: Capture, monkeypatch: pytest.MonkeyPatch):
    with emulated("frame", "--pty") as url:
        path = url.removeprefix("frame:")
        monkeypatch.setattr(_core, "serial_ports", lambda: [port(path, 0x2E8A, "Pico")])
        assert app.run(["devices", "--json"]) == 0
        assert by(records(capsys), "port")["answers"] == {}
        assert app.run(["devices", "--json", "--probe"]) == 0
        assert by(records(capsys), "port")["answers"] == {url: "1 axis, 20 N at most"}


def test_serial_ports_of_this_machine():
    found = _core.serial_ports()
    assert all(one.path and (one.usb is None or one.usb.vendor) for one in found)


TICK = 44100 / 44
GESTURE = "0mm@0 12mm@1/10 0mm@1/4"


def followed(n: int) -> list[float]:
    """Positions of the key of the emulator, which rests in the first period [m]."""
    hand = sampled_positions(notation.parse(GESTURE).points, 1.0, TICK)
    return [0.0, *pulled(hand, TICK, n - 1)]


def test_take_record_stores_hand_positions(capsys: Capture):
    with emulated("frame", "--udp", "0", "--lockstep", "--gesture", GESTURE) as url:
        live = f"remi={url}&wide"
        assert app.run(["take", "record", "--live", live, "-o", "a.take", "--seconds", "0.4"]) == 0
        assert "wrote a.take: remi" in capsys.readouterr().err
        assert app.run(["take", "record", "--live", live, "-o", "a.take"]) == 2
    result = _core.read_recording("a.take")
    assert result.is_complete
    assert result.frames == 44
    n = len(result.ticks())
    assert 0 <= n - round(0.4 * TICK) < 20
    # Before the first tick it is asked where it is, and nothing is sent.
    assert result.positions()[:, 0] == pytest.approx(np.array(followed(n)), abs=1e-12)
    assert not np.any(result.forces())
    assert not np.any(result.sent())
    assert json.loads(result.about)["axes"][0]["device"] == f"{live.removeprefix('remi=')}#0"


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("_wait_until_over", ["take", "record", "--live", "emul:", "-o", "c.take"]),
        ("doctor", ["doctor", "--no-audio", "--seconds", "3600"]),
        ("calibrate", ["devices", "calibrate", "BOARD", "--seconds", "60"]),
    ],
)
def test_ctrl_c_ends_recording_with_exit_130(folder: Path, name: str, asked: list[str]):
    with (
        Board(1e-3) as board,
        subprocess.Popen(
            [
                *(sys.executable, "-c", CHILD, name),
                *(board.url if a == "BOARD" else a for a in asked),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process,
    ):
        assert process.stdout is not None
        while "begun" not in process.stdout.readline():
            assert process.poll() is None
        if "record" in asked:
            until(lambda: Path("c.take").stat().st_size > 10_000, "a recording")
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=PATIENCE) == 130
        finally:
            process.kill()  # else a failure would wait for its end
    if "record" in asked:
        result = _core.read_recording("c.take")
        assert result.is_complete
        assert len(result.ticks()) > 100
    assert not (folder / "config").exists()


def test_take_record_of_two_unnamed_hands(capsys: Capture):
    with emulated("frame", "--udp", "0", "--axes", "2", "--lockstep") as url:
        hands = [part for axis in (0, 1) for part in ("--live", f"{url}#{axis}")]
        asked = ["take", "record", *hands, "--tick", "500", "-o", "b.take", "--seconds", "0.1"]
        assert app.run(asked) == 0
    result = _core.read_recording("b.take")
    assert (result.names, result.frames) == (["hand", "hand2"], 88)


def test_take_record_refusals(capsys: Capture):
    record = ["take", "record", "--live"]
    assert app.run([*record, "frame:/dev/nowhere", "-o", "x.take"]) == 3
    assert not Path("x.take").exists()
    assert app.run([*record, "emul:", "-o", "x.wav"]) == 2
    assert app.run([*record, "emul:"]) == 2
    assert app.run([*record, "emul:", "--live", "emul:", "-o", "x.take"]) == 2
    assert "is given to two players" in capsys.readouterr().err


@pytest.fixture(scope="module")
def faults_page() -> str:
    return faults.page()


def test_faults_page_equals_measured_faults(faults_page: str):
    committed = (Path(__file__).parents[2] / "docs/faults.md").read_text(encoding="utf-8")
    assert committed == faults_page  # make docs


def test_doctor_safety_rows_of_all_faults_and_devices(capsys: Capture):
    assert app.run(["doctor", "--safety", "--json"]) == 0
    rows = records(capsys)
    assert {r["event"] for r in rows} == {"fault"}
    assert {r["device"] for r in rows} == {"emul", "frame", "firefader", "haply"}
    assert len(rows) == 4 * len({r["fault"] for r in rows}) == 80
    assert not any(r["exceeds"] for r in rows)
    (nan,) = (r for r in rows if r["device"] == "frame" and "NaN" in r["fault"])
    assert nan["seconds"] == nan["bound"] == 1e-3


def test_doctor_safety_exit_1_above_force_bound(capsys: Capture, monkeypatch: pytest.MonkeyPatch):
    cell = FaultResult("frame", "60 ms", 0.06, 0.05, 1.0, 0.1, exceeds=True)
    monkeypatch.setattr(
        "ergon.live.faults.measure_faults", lambda: [FaultRow("the port is gone", [cell])]
    )
    assert app.run(["doctor", "--safety"]) == 1
    output = capsys.readouterr()
    assert "EXCEEDS ITS BOUND" in output.out
    assert "the port is gone, frame" in output.err
