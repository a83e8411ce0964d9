"""Axes as they were found: tried, remembered between a person's own lines, and applied."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from boards import Board, emulated

from ergon import _core
from ergon.api.errors import OptionError
from ergon.api.hands import calibrated_boards
from ergon.cli import app
from ergon.common.report import Report
from ergon.live import boards
from ergon.live.boards import BoardError, config_path, device_urls
from ergon.live.calibration import (
    AxisCalibration,
    axis_key,
    calibrated_axes,
    confirm_axes,
    store_axis,
    stored_calibrations,
)
from ergon.live.display import event_sentence

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
Capture = pytest.CaptureFixture[str]
AXIS = AxisCalibration(-1, 0.0125, 2.0, (-0.03, 0.03), 3.5)
USER_FILE = """\
# my keys
[devices]
tgr0 = "frame:/dev/ttyACM0"   # the left one
far = 'frame+udp:10.0.0.7:9999?wide#3'

[calibration."frame:/dev/ttyACM9#0"]
sign = 1
zero = 0.0
gain = 1.0
range = [-0.01,
  0.01]
force_max = 2.0

# what others keep here
[other]
rows = ["[calibration]", 'x']
"""


@pytest.fixture(autouse=True)
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("NO_COLOR", "1")
    assert config_path() == tmp_path / "config/ergon/devices.toml"
    return config_path()


def written(config: Path, text: str) -> None:
    config.parent.mkdir(parents=True, exist_ok=True)
    config.write_bytes(text.encode())


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_store_axis_preserves_other_lines_of_config(config: Path, end: str):
    single = USER_FILE.replace("\n", end)
    written(config, single)
    store_axis("frame:/dev/ttyACM0?lockstep", 2, AXIS)
    text = config.read_bytes().decode()
    assert text.startswith(single + end + '[calibration."frame:/dev/ttyACM0#2"]' + end)
    assert stored_calibrations("frame:/dev/ttyACM0") == {2: AXIS}
    # Again: only its own table is another one.
    other = AxisCalibration(1, 1e-5, -1.0, (0.0, 0.02), 1.0)
    store_axis("frame:/dev/ttyACM9", 0, other)
    begin, rest = single.split(f'[calibration."frame:/dev/ttyACM9#0"]{end}')
    changed = config.read_bytes().decode()
    assert changed.startswith(begin)
    assert changed.endswith(text[text.index(f"{end}# what others") :])
    assert stored_calibrations("frame:/dev/ttyACM9") == {0: other}
    assert boards.device_urls() == {
        "tgr0": "frame:/dev/ttyACM0",
        "far": "frame+udp:10.0.0.7:9999?wide#3",
    }
    assert "range = [-0.01" not in changed
    assert "range = [-0.01" in rest


@pytest.mark.parametrize(
    "text",
    [
        'calibration = {"emul:#0" = {sign = 1}}\n',
        '[calibration]\n"emul:#0".sign = 1\n',
        'x = """\n[calibration."emul:#0"]\n"""\n',
        "calibration = 3\n",
    ],
)
def test_uneditable_calibration_files_stay_unchanged(config: Path, text: str):
    written(config, text)
    with pytest.raises(BoardError, match=r"that ergon cannot edit|is not a table"):
        store_axis("emul:", 0, AXIS)
    assert config.read_bytes().decode() == text


@pytest.mark.parametrize("field", ["sign", "zero", "gain", "force_max"])
@pytest.mark.parametrize("value", ["inf", "-inf", "nan", "1" + "0" * 400, '"1"', "[]", "true"])
def test_known_axes_refuses_wrong_numbers_with_place(config: Path, field: str, value: str):
    store_axis("emul:", 0, AXIS)
    lines = config.read_text().splitlines()
    index = next(i for i, line in enumerate(lines) if line.startswith(f"{field} = "))
    lines[index] = f"{field} = {value}"
    config.write_text("\n".join(lines) + "\n")
    with pytest.raises(BoardError, match=rf'{config}: \[calibration."emul:#0"\]'):
        stored_calibrations("emul:")


def test_known_axes_refuses_sign_other_than_one(config: Path):
    store_axis("emul:", 0, AXIS)
    config.write_text(config.read_text().replace(f"sign = {AXIS.sign}", "sign = 1.9"))
    with pytest.raises(BoardError):
        stored_calibrations("emul:")


def test_store_axis_in_new_file_and_through_symlink(config: Path, tmp_path: Path):
    store_axis("emul:?mass=0.1", 0, AXIS)
    assert stored_calibrations("emul:?mass=0.1") == {0: AXIS}
    assert stored_calibrations("emul:") == {}
    real = tmp_path / "elsewhere.toml"
    config.rename(real)
    config.symlink_to(real)
    store_axis("emul:", 1, AXIS)
    assert config.is_symlink()
    assert stored_calibrations("emul:") == {1: AXIS}


def test_axis_key_ignores_url_options():
    assert axis_key("frame+udp:1.2.3.4:5?lockstep&wide", 3) == "frame+udp:1.2.3.4:5#3"
    assert axis_key("haply:ws://h?id=A&lockstep", 0) == "haply:A#0"
    assert axis_key("haply:ws://h?lockstep", 0) == "haply:ws://h#0"


@pytest.mark.parametrize(
    ("url", "is_one"),
    [
        ("emul:", True),
        ("firefader:/dev/pts/3", True),
        ("frame:/dev/ttyACM0?wide&lockstep", False),
        ("frame+udp://127.0.0.1:9", True),
        ("frame+udp:192.168.1.7:9", False),
        ("firefader:/dev/ttyACM0", False),
        ("haply:ws://127.0.0.1:10001", False),
    ],
)
def test_board_is_emulated_by_address(url: str, is_one: bool):
    assert boards.Board(url, ()).is_emulated is is_one


# A finger that lies still for three seconds, then goes 20 mm up and 10 mm down.
GOES = "0mm@0 line 0mm@3 smooth 20mm@4 -10mm@5 0mm@6"


def test_calibrate_finds_ends_and_gain_of_hand_motion(config: Path, capsys: Capture):
    strong = ("--hand", "2000N/m", "--grip", "40Ns/m")
    with emulated("frame", "--pty", "--lockstep", "--gesture", GOES, *strong) as url:
        written(config, f'[devices]\nmine = "{url}"\n')
        asked = ["devices", "calibrate", "mine", "--seconds", "6", "--travel", "60mm", "--json"]
        assert app.run([*asked, "--force-max", "3"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["sign"] == 1
    assert record["zero"] == pytest.approx(5e-3, abs=1e-3)
    # 60 mm by the ruler, 30 mm by the device.
    assert record["gain"] == pytest.approx(2.0, rel=0.05)
    assert record["range"] == [-0.03, 0.03]
    assert record["force_max"] == 3.0
    result = stored_calibrations(url)[0]
    assert (result.zero, result.force_max) == (record["zero"], 3.0)


def test_calibrate_corrects_reversed_motor(config: Path, capsys: Capture):
    with Board(-1e-3) as board:
        assert app.run(["devices", "calibrate", board.in_lockstep, "--seconds", "0"]) == 0
        assert "the other way round, which is corrected" in capsys.readouterr().err
        assert stored_calibrations(board.in_lockstep)[0].sign == -1
        # A fifth of its force is as much as it gets.
        assert 0.1 < board.strongest < 4.01
        device = _core.Device(
            board.in_lockstep, [stored_calibrations(board.in_lockstep)[0].for_core(0)]
        )
        assert device.direction(0, 1e-3) == 1.0
        device.close()
        assert (
            app.run(["devices", "calibrate", board.in_lockstep, "--turned", "--seconds", "0"]) == 0
        )
    assert stored_calibrations(board.in_lockstep)[0].gain == -1.0
    assert stored_calibrations(board.in_lockstep)[0].range == pytest.approx((-0.05, 0.05))


def test_calibrate_refuses_unmoved_and_unknown_axes(config: Path, capsys: Capture):
    with Board(0.0) as board:
        assert app.run(["devices", "calibrate", board.in_lockstep]) == 2
        assert "did not move" in capsys.readouterr().err
        assert app.run(["devices", "calibrate", board.in_lockstep, "--axis", "3"]) == 2
        assert "axis 3 does not exist" in capsys.readouterr().err
    assert not config.exists()
    assert app.run(["devices", "calibrate", "frame:/dev/nowhere"]) == 3
    assert app.run(["devices", "calibrate", "nobody"]) == 2


class Sentences(Report):
    """A report that keeps its sentences."""

    def __init__(self) -> None:
        self.sentences: list[str] = []

    def say(self, sentence: str) -> None:
        self.sentences.append(sentence)

    def warn(self, sentence: str, **_: object) -> None:
        self.sentences.append(sentence)


SCORE = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}
      b: {BUT: {between: [k, m], K: 100N/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 0mm@1/2}
players: {remi: {hand: live, key: k, standin: knock}}
render: {tail: 0.2s}
"""


def test_duet_checks_axis_direction_before_each_start(
    config: Path, tmp_path: Path, capsys: Capture
):
    (tmp_path / "s.yaml").write_text(SCORE)
    duet = ["duet", "s.yaml", "--audio", "null", "--gain", "-20dB", "--live"]
    with Board(-1e-3) as board:
        assert app.run([*duet, f"remi={board.in_lockstep}", "--plain", "--unchecked"]) == 0
        assert "let go of the key" not in capsys.readouterr().err
        assert not config.exists()
        assert app.run([*duet, f"remi={board.in_lockstep}", "--plain", "--record", "a.take"]) == 0
        assert "let go of the key" in capsys.readouterr().err
        assert stored_calibrations(board.in_lockstep)[0].sign == -1
        # Who answers at an address is not known by what answered there before.
        assert app.run([*duet, f"remi={board.in_lockstep}", "--plain"]) == 0
        assert "let go of the key" in capsys.readouterr().err
        board.gain = 1e-3
        assert app.run([*duet, f"remi={board.in_lockstep}", "--plain"]) == 0
        assert "taken for another board" in capsys.readouterr().err
        assert stored_calibrations(board.in_lockstep)[0].sign == 1
        board.gain = -1e-3
    about = json.loads(_core.read_recording("a.take").about)
    assert about["axes"][0]["device"] == f"{board.in_lockstep}#0"
    assert about["axes"][0]["calibration"]["sign"] == -1
    with Board(0.0) as stuck:
        assert app.run([*duet, f"remi={stuck.in_lockstep}"]) == 2
        output = capsys.readouterr().err
        assert "remi: the axis did not move" in output
        assert "--unchecked" in output


def test_calibrated_boards_direction_of_twelve_keys(config: Path):
    """One request for all; a key whose calibration is wrong is tried alone, and refused by name."""
    report = Sentences()
    with emulated("frame", "--udp", "0", "--lockstep", "--axes", "12") as url:
        players = {f"p{number}": f"{url}#{number}" for number in range(12)}
        twelve = boards.boards(players, {})
        calibrated_boards(twelve, False, report)
        (asked,) = report.sentences
        assert asked.startswith("p0, p1, p2")
        assert "let go of the keys: small pulses" in asked
        store_axis(url, 4, AxisCalibration(-1, 0.0, 1.0, (-0.05, 0.05), 20.0))
        with pytest.raises(OptionError, match="the motor pushes the wrong way") as refused:
            calibrated_boards(twelve, False, report)
    assert refused.value.value == "p4"


def test_recorded_force_sent_one_tick_later(tmp_path: Path):
    (tmp_path / "s.yaml").write_text(SCORE)
    with emulated("frame", "--udp", "0", "--lockstep", "--gesture", "0mm@0 8mm@1/2") as url:
        duet = ["duet", "s.yaml", "--audio", "null", "--gain", "-20dB", "--record", "b.take"]
        assert app.run([*duet, "--live", f"remi={url}&wide", "-q"]) == 0
    result = _core.read_recording("b.take")
    forces, sent = result.forces()[:, 0], result.sent()[:, 0]
    assert np.any(forces)
    assert np.flatnonzero(sent)[0] == np.flatnonzero(forces)[0] + 1


def test_calibration_by_usb_identity_at_any_port(config: Path, monkeypatch: pytest.MonkeyPatch):
    plugged = {"/dev/ttyACM0": "usb:16c0:0483:11", "/dev/ttyACM1": "usb:16c0:0483:22"}
    monkeypatch.setattr(_core, "serial_identity", plugged.get)
    store_axis("frame:/dev/ttyACM0?lockstep", 2, AXIS)
    assert '[calibration."usb:16c0:0483:11#2"]' in config.read_text()
    assert stored_calibrations("frame:/dev/ttyACM0") == {2: AXIS}
    assert calibrated_axes("frame:/dev/ttyACM0") == {2}
    assert stored_calibrations("frame:/dev/ttyACM1") == {}
    # Plugged in the other way round.
    plugged["/dev/ttyACM0"], plugged["/dev/ttyACM1"] = plugged["/dev/ttyACM1"], "usb:16c0:0483:11"
    assert stored_calibrations("frame:/dev/ttyACM0") == {}
    assert calibrated_axes("frame:/dev/ttyACM1") == {2}


def test_calibration_by_path_valid_until_identity_known(
    config: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(_core, "serial_identity", lambda path: None)
    store_axis("frame:/dev/ttyACM0", 0, AXIS)
    assert stored_calibrations("frame:/dev/ttyACM0") == {0: AXIS}
    assert calibrated_axes("frame:/dev/ttyACM0") == set()
    # The board that is there now has a number: what is found of it is its own.
    monkeypatch.setattr(_core, "serial_identity", lambda path: "usb:16c0:0483:11")
    assert stored_calibrations("frame:/dev/ttyACM0") == {0: AXIS}
    assert calibrated_axes("frame:/dev/ttyACM0") == set()
    other = AxisCalibration(1, 0.0, 1.0, (-0.05, 0.05), 1.0)
    store_axis("frame:/dev/ttyACM0", 0, other)
    assert stored_calibrations("frame:/dev/ttyACM0") == {0: other}
    assert calibrated_axes("frame:/dev/ttyACM0") == {0}


def test_board_messages_with_device_name_without_options() -> None:
    url = "frame+udp://127.0.0.1:40123?lockstep&patience=300"
    asked = {"remi": "tgr0.1", "ada": "tgr0.0", "zoe": "emul:?lockstep#1"}
    shown = [one.display_name for one in boards.boards(asked, {"tgr0": url})]
    assert shown == ["tgr0", "emul:"]
    text = event_sentence((0, "gone", 0.0), ["remi"], shown)
    assert text == "tgr0 is disconnected; its stand-in plays on"


def test_config_path_with_relative_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("XDG_CONFIG_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert config_path() == tmp_path / ".config/ergon/devices.toml"


def test_devices_without_home_folder(monkeypatch: pytest.MonkeyPatch):
    def no_home() -> Path:
        raise RuntimeError("no home")

    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setattr(Path, "home", no_home)
    assert device_urls() == {}
    with pytest.raises(BoardError, match="set HOME or XDG_CONFIG_HOME"):
        store_axis("frame:/dev/ttyACM0", 0, AXIS)


class PassedOverDevice:
    """A device of which the axes `still` do not move at the first push, or, held, at any."""

    def __init__(self, still: set[int], held: set[int]) -> None:
        self.still, self.held, self.pushes = still, held, []

    def directions(self, axes: list[int], period: float) -> list[float | None]:
        self.pushes.append(axes)
        unmoved = self.held | (self.still if len(self.pushes) == 1 else set())
        return [None if axis in unmoved else 1.0 for axis in axes]

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("still", "held", "pushed_again", "moved"),
    [
        (set(), set(), [], [0, 1, 2, 3]),
        ({0, 1, 2, 3}, set(), [[0, 1, 2, 3]], [0, 1, 2, 3]),
        ({1}, {2}, [[1, 2]], [0, 1, 3]),
        (set(), {2}, [], [0, 1, 3]),  # one alone is tried alone by the caller
    ],
)
def test_axes_as_known_pushes_still_axes_again(
    still: set[int],
    held: set[int],
    pushed_again: list[list[int]],
    moved: list[int],
    monkeypatch: pytest.MonkeyPatch,
):
    device = PassedOverDevice(still, held)
    monkeypatch.setattr(_core, "Device", lambda url, axes: device)
    known = {number: AxisCalibration(1, 0.0, 1.0, (-0.01, 0.01), 2.0) for number in range(4)}
    assert list(confirm_axes("frame:x", known)) == moved
    assert device.pushes == [[0, 1, 2, 3], *pushed_again]
