"""`ergon metrology`: takes or a device to a table, a calibration, and a key of a score."""

import json
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Set
from pathlib import Path

import numpy as np
import pytest
from commands import ERGON, records
from emulators import emulator
from measured_keys import KEY, Floats, knocks, path, rain, read
from patience import PATIENCE
from recordings import Axis, end, header, row, rows
from sweep import few

from ergon.cli import app
from ergon.cli.console import Console
from ergon.cli.metrology_fit import write_texts
from ergon.exchange.safe import FileRefusedError

NONE: Set[int] = frozenset()
SECONDS = 4.0  # of the rain
Capture = pytest.CaptureFixture[str]


def take(
    name: str | Path,
    force: Floats,
    seed: int,
    hands: int = 1,
    lost: int = 0,
    gap: Set[int] = NONE,
    force_step: float = 0.0,
) -> None:
    """A recording of a key that was pushed.

    Of every `lost` ticks one brought no new position; rows of the ticks `gap` are missing. The
    motor rounds forces to `force_step` [N]; the recording has them as they were sent.
    """
    acted = np.round(force / force_step) * force_step if force_step else force
    x = read(path(KEY, acted, 176), seed)
    axes = [(f"hand{i}", f"k{i}") for i in range(hands)]
    fresh = np.ones(len(force), bool)
    if lost:
        fresh[lost - 1 :: lost] = False
        x[~fresh] = x[np.flatnonzero(~fresh) - 1]
    # The force of a row went out before its position came in: it is that of the tick before.
    sent = np.concatenate([[0.0], force[:-1]])
    each = [
        row(k, *[Axis(float(x[k]), 0.0, float(sent[k]), int(fresh[k]))] * hands)
        for k in range(len(force))
    ]
    each = [one for k, one in enumerate(each) if k not in gap]
    chunks = [rows(*each[i : i + 250]) for i in range(0, len(each), 250)]
    Path(name).write_bytes(b"".join([header(axes), *chunks, end()]))


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of takes that no test changes."""
    built = tmp_path_factory.mktemp("takes")
    take(built / "rain.take", rain(KEY, SECONDS), 1)
    take(built / "knocks.take", knocks(KEY), 2)
    return built


@pytest.fixture(autouse=True)
def folder(work_folder: Path, takes: Path) -> Path:
    shutil.copytree(takes, work_folder, dirs_exist_ok=True)
    return work_folder


def test_metrology_fit_and_score_using_calibration(capsys: Capture):
    command = ["metrology", "fit", "rain.take", "--held-out", "knocks.take", "-o", "k.yaml"]
    assert app.run(command) == 0
    output = capsys.readouterr()
    table = output.out.splitlines()
    assert [line[:12].strip() for line in table[1:7]] == [
        "M K Z",
        "+ dry",
        "+ presliding",
        "+ Stribeck",
        "+ delay",
        "+ mode",
    ]
    assert all("not kept" in line for line in table[3:5])
    assert " g at 18" in table[6] or " g at 179" in table[6]
    assert "the sensor's noise is 4" in output.err
    assert "its step is 7.32 um" in output.err
    assert " ".join(table[0].split()) == "fit rms of step replay of step BIC what was added"
    # Of the last row: 4.2 um are 0.58 steps of 7.32 um, in the fit and in the replay.
    left, off, bic = (float(table[6].replace(",", "").split()[i]) for i in (4, 7, 8))
    assert 0.55 < left < 0.61
    assert 0.55 < off < 0.61
    assert bic < -24_000 * SECONDS
    take("again.take", knocks(KEY), 3)
    assert app.run(["metrology", "replay", "k.yaml", "again.take", "--width", "80"]) == 0
    output = capsys.readouterr()
    shown = output.out.splitlines()
    assert [line.split("[")[0].strip() for line in shown if "] " in line] == [
        "force",
        "position",
        "residual",
    ]
    assert "asked" in shown[0]
    assert any("real" in line and "model" in line for line in shown)
    assert max(map(len, shown)) <= 80
    every = shown[-1].split()
    assert (every[0], every[2]) == ("all", "um")
    assert 0.55 < float(every[3]) < 0.61
    stiff = re.sub(r"(?m)^K: [0-9.]+", "K: 50", Path("k.yaml").read_text())
    Path("stiff.yaml").write_text(stiff)
    assert app.run(["metrology", "compare", "k.yaml", "stiff.yaml"]) == 0
    output = capsys.readouterr()
    assert "mode 1 f [Hz]" in output.out
    assert "more than 3 standard deviations apart: K by" in output.err
    assert "of 9 figures with their covariance" in output.err
    assert app.run(["metrology", "compare", "k.yaml", "k.yaml"]) == 0
    assert "no figure differs" in capsys.readouterr().err
    text = Path("k.yaml").read_text()
    # Known to a hundredth, and within four of the deviations that are written beside them.
    figures = re.findall(r"(?m)^(\w+): (\S+?)[A-Za-z/]+ # ± (\S+)$", text)
    true = {"M": 400.0, "rest": -2.5, "K": 60.0, "Z": 1.2, "dry": 50.0, "delay": 1e3 * KEY[6]}
    assert [name for name, *_ in figures] == [*true]
    for name, value, deviation in figures:
        bound = min(4.0 * float(deviation), 0.01 * abs(true[name]))
        assert abs(float(value) - true[name]) < bound, name
    assert "modes:\n  - {M: " in text
    assert "takes:\n  - " in text
    score = "ergon: 1\nkeys:\n  k: {calib: k.yaml}\ngestures:\n  g: '0mm@0 1mm@1 0mm@2'\n"
    Path("s.yaml").write_text(score + "parts:\n  - {key: k, at: 1|1, play: g}\n")
    app.run(["check", "s.yaml"])
    printed = capsys.readouterr().err
    assert "k.yaml" not in printed, printed


@pytest.mark.slow
def test_metrology_fit_json_values_and_deviations(capsys: Capture):
    take("rain.take", rain(KEY), 1, lost=100)
    assert app.run(["metrology", "fit", "rain.take", "--json"]) == 0
    records_read = records(capsys)
    stages = [record for record in records_read if record["event"] == "stage"]
    assert [stage["name"] for stage in stages][:2] == ["M K Z", "dry"]
    mode = next(stage for stage in stages if stage["name"] == "mode")
    assert mode["kept"]
    for name, true in (("mass", 0.38), ("dry", 0.05), ("mode_frequency_1", 180.0)):
        result = mode["parameters"][name]
        assert abs(result["value"] - true) < 5 * result["deviation"]
    assert records_read[-1]["event"] == "measured"


@pytest.mark.slow
def test_metrology_fit_of_take_with_lost_ticks(capsys: Capture):
    """Nobody knows the forces of a hundredth of the ticks; they are found with the key."""
    gap = set(np.random.default_rng(3).choice(np.arange(200, 6000), 60, replace=False).tolist())
    take("rain.take", rain(KEY, 6.0), 1, gap=gap)
    assert app.run(["metrology", "fit", "rain.take", "--json"]) == 0
    records_read = records(capsys)
    saved = [record for record in records_read if record["event"] == "stage" and record["kept"]]
    last = saved[-1]
    # Whatever stood for the mode before it was known is taken away.
    assert "mode_frequency_1" in last["parameters"]
    assert not {"presliding", "static_dry"} & last["parameters"].keys()
    assert last["rms_m"] < 4.5e-6
    for name, true in (("mass", 0.38), ("stiffness", 60.0), ("dry", 0.05), ("delay", KEY[6])):
        result = last["parameters"][name]
        assert abs(result["value"] - true) < 4.5 * result["deviation"], name


CALIBRATION = """ergon: 1
M: 400g
rest: -2.5mm
K: 60N/m
Z: 1.2Ns/m
dry: 50mN
delay: 0.997732ms
modes:
  - {M: 20g, f: 180Hz, t60: 0.305388s}
"""


def test_replay_with_force_step(capsys: Capture):
    """What the motor rounds away moves the model, unless the step is known."""
    take("coarse.take", knocks(KEY), 2, force_step=50e-3)
    Path("key.yaml").write_text(CALIBRATION)
    residuals = []
    for step in ([], ["--force-step", "50mN"]):
        assert app.run(["metrology", "replay", "key.yaml", "coarse.take", "--json", *step]) == 0
        residuals.append(records(capsys)[-1]["rms_m"])
    assert residuals[0] > 20e-6
    assert residuals[1] < 4.6e-6


@pytest.mark.slow
def test_fit_with_force_step(capsys: Capture):
    take("coarse.take", rain(KEY), 1, force_step=50e-3)
    measured = []
    for step in ([], ["--force-step", "50mN"]):
        app.run(["metrology", "fit", "coarse.take", "--json", *step])
        stages = [
            calibration
            for calibration in records(capsys)
            if calibration["event"] == "stage" and calibration["kept"]
        ]
        measured.append(stages[-1])
    assert measured[0]["rms_m"] > 20e-6
    assert measured[1]["rms_m"] < 4.6e-6
    for name, true in (("mass", 0.38), ("dry", 0.05), ("mode_frequency_1", 180.0)):
        figure = measured[1]["parameters"][name]
        assert abs(figure["value"] - true) < 5 * figure["deviation"]


def test_fit_refuses_force_step_above_all_forces(capsys: Capture):
    assert app.run(["metrology", "fit", "rain.take", "--force-step", "5N"]) == 2
    assert "a motor with a step of 5000 mN makes no force of this take" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.take"], "none.take"),
        (["two.take"], "choose by --hand"),
        (["two.take", "--hand", "eve"], "there is no hand 'eve'"),
        (["still.take"], "no force that was sent"),
        (["short.take"], "at least 500 ticks"),
        (["gap.take"], "this take lacks 150 of 1,002 ticks"),
    ],
)
def test_fit_refuses_unsuitable_takes(capsys: Capture, arguments: list[str], message: str):
    take("two.take", rain(KEY, 1.0), 1, hands=2)
    take("still.take", np.zeros(1000), 1)
    take("gap.take", rain(KEY, 1.0), 1, gap=set(range(100, 250)))
    take("short.take", rain(KEY, 0.2), 1)
    assert app.run(["metrology", "fit", *arguments]) == 2
    assert message in capsys.readouterr().err


# The key of `measured_keys`, behind a device of 12 bits.
EMULATED = (
    *("--mass=380g", "--stiffness=60N/m", "--damping=1.2Ns/m", "--dry=50mN", "--weight=0.15N"),
    *("--mode=20g 180Hz 0.02", "--travel=30mm", "--force-max=1.56N", "--resolution=7.32um"),
    *("--noise=3.66um", "--free", "--lockstep"),
)


@pytest.mark.slow
def test_metrology_of_device_fit_compare_and_list(capsys: Capture):
    """As a user does it: measure, look again, compare, list, weigh."""
    with emulator("frame", "--udp", "0", *EMULATED) as board:
        url = board.url + "&patience=600"
        command = ["metrology", url, "-o", "key.yaml", "--seconds", "5", "--json"]
        assert app.run(command) == 0
        records_read = records(capsys)
        assert [one["event"] for one in records_read][:2] == ["rung", "rung"]
        last = [one for one in records_read if one["event"] == "stage" and one["kept"]][-1]
        assert last["name"] == "mode"
        for name, true in (("mass", 0.38), ("stiffness", 60.0), ("damping", 1.2), ("dry", 0.05)):
            result = last["parameters"][name]
            assert abs(result["value"] - true) < 4.5 * result["deviation"], name
        for name in ("key.svg", "key.strikes.take", "key.rain.take", "key.held-out.take"):
            assert Path(name).exists()
        assert app.run(["metrology", "replay", "key.yaml", url, "--json"]) == 0
        assert records(capsys)[-1]["rms_m"] < 5e-6
    takes = ["key.strikes.take", "key.rain.take", "--held-out", "key.held-out.take"]
    assert app.run(["metrology", "fit", *takes, "--json"]) == 0
    output = capsys.readouterr()
    again = json.loads(output.out.splitlines()[-2])
    assert "an older take" not in output.err
    assert again["parameters"] == last["parameters"] or not again["kept"]
    assert app.run(["metrology", "compare", "key.yaml", "key.yaml", "--json"]) == 0
    assert records(capsys)[-1]["replay_difference_m"] == 0
    assert app.run(["metrology", "log", "key.yaml"]) == 0
    assert "key.yaml" in capsys.readouterr().out
    text = Path("key.yaml").read_text()
    heavy = text.replace("M: 4", "M: 5").replace("M: 39", "M: 49")
    Path("heavy.yaml").write_text(heavy)
    assert app.run(["metrology", "weigh", "key.yaml", "heavy.yaml", "--mass", "100g"]) == 0
    output = capsys.readouterr()
    assert "true over found: 1 ± " in output.out
    assert "does not sink" in output.err


TRUE = """ergon: 1
M: 400.0g # ± 0.01
rest: -2.5mm # ± 1e-5
K: 60N/m # ± 0.001
Z: 1.2Ns/m # ± 0.0001
dry: 50mN # ± 0.005
modes:
  - {M: 20g, f: 180Hz, t60: 0.30540s}
date: 2026-11-22
"""
SCORE = """ergon: 1
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}}
gestures: {knock: 0mm@0 2mm@1/8 0mm@1/4}
players: {ada: {key: k1}, remi: {key: k2}}
parts: {remi: [{at: 3|1, play: knock, every: 1, times: 5}]}
"""


def test_metrology_replay_of_score_gesture_on_device(capsys: Capture):
    """Five knocks, half a second apart, from the first movement on; the model goes with the key."""
    Path("true.yaml").write_text(TRUE)
    Path("duet.yaml").write_text(SCORE)
    with emulator("frame", "--udp", "0", *EMULATED) as board:
        url = board.url + "&patience=600"
        command = ["metrology", "replay", "true.yaml", url, "--score", "duet.yaml"]
        assert app.run([*command, "--key", "k2", "--json"]) == 0
        *seconds, last = records(capsys)
        assert last["rms_m"] < 5e-6
        assert len(seconds) == 3
        assert all(second["real_m"] > 1e-3 for second in seconds)
        assert app.run(command) == 2
        assert "choose a key of the score by --key" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_metrology_replay_with_browser_view():
    Path("true.yaml").write_text(TRUE)
    take("short.take", rain(KEY, 1.0), 1)
    command = [*ERGON, "metrology", "replay", "true.yaml", "short.take", "--view", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        output = map(json.loads, process.stdout)
        ready = next(record for record in output if record["event"] == "ready")
        with urllib.request.urlopen(ready["url"] + "motion", timeout=PATIENCE) as answer:
            assert answer.read(4) == b"ERGM"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["emul:", "--score", "duet.yaml", "--key", "k1"], "nothing moves the key k1"),
        (["emul:", "--score", "duet.yaml", "--key", "k3"], "no player of the score has the key"),
        (["emul:", "--key", "k1"], "write --score too"),
        (["knocks.take", "--score", "duet.yaml"], "a take has its own gesture"),
    ],
)
def test_replay_refuses_scores_without_gestures_of_the_key(
    capsys: Capture, words: list[str], message: str
):
    Path("true.yaml").write_text(TRUE)
    Path("duet.yaml").write_text(SCORE)
    assert app.run(["metrology", "replay", "true.yaml", *words]) == 2
    assert message in capsys.readouterr().err


def test_metrology_of_disconnected_device_saves_take(capsys: Capture):
    """The host is told, and what was recorded is kept."""
    with emulator("frame", "--pty", *EMULATED, "--seconds", "25") as board:
        assert app.run(["metrology", board.url, "-o", "key.yaml"]) == 2
    output = capsys.readouterr().err
    assert "the device no longer answers" in output or "unplugged" in output
    assert "kept key.strikes.take" in output
    assert Path("key.strikes.take").stat().st_size > 1000
    assert not Path("key.yaml").exists()


@pytest.mark.parametrize(
    ("command", "code", "message"),
    few(
        [
            (["emul:"], 2, "-o FILE says where"),
            (["nobody"], 2, "No such command 'nobody'"),
            (["frame+udp:127.0.0.1:1", "-n"], 3, "127.0.0.1:1"),
            (["emul:#7", "-n"], 2, "axis 7 does not exist"),
            (["replay", "rain.take", "knocks.take"], 2, "this file is not text"),
            (["compare", "none.yaml", "none.yaml"], 2, "none.yaml"),
        ],
        2,
    ),
)
def test_metrology_refuses_wrong_commands_and_devices(
    capsys: Capture, command: list[str], code: int, message: str
):
    assert app.run(["metrology", *command]) == code
    assert message in capsys.readouterr().err


def test_write_texts_refuses_edited_calibration_or_picture(tmp_path: Path):
    texts = {tmp_path / "k.yaml": "a calibration\n", tmp_path / "k.svg": "a picture\n"}
    console = Console(quiet=True)
    for _ in range(2):
        write_texts(console, texts, force=False, dry=False)
    for file, text in texts.items():
        file.write_text(f"{text}edited\n")
        with pytest.raises(FileRefusedError, match="-f overwrites it"):
            write_texts(console, texts, force=False, dry=False)
        assert file.read_text() == f"{text}edited\n"
        write_texts(console, texts, force=True, dry=False)
    assert {file: file.read_text() for file in texts} == texts
