"""`ergon metrology fit`: takes to a table, a calibration, and a key of a score."""

from collections.abc import Set
from pathlib import Path

import numpy as np
import pytest
from commands import records
from measured_keys import KEY, Floats, knocks, path, rain, read
from recordings import Axis, end, header, row, rows

from ergon.cli import app

NONE: Set[int] = frozenset()
Capture = pytest.CaptureFixture[str]


def take(
    name: str, force: Floats, seed: int, hands: int = 1, lost: int = 0, gap: Set[int] = NONE
) -> None:
    """A recording of a key that was pushed.

    Of every `lost` ticks one brought no new position; rows of the ticks `gap` are missing.
    """
    x = read(path(KEY, force, 176), seed)
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


@pytest.fixture(autouse=True)
def folder(own_folder: Path) -> Path:
    take("rain.take", rain(KEY), 1)
    take("knocks.take", knocks(KEY), 2)
    return own_folder


def test_a_key_is_measured_and_a_score_takes_it(capsys: Capture):
    command = ["metrology", "fit", "rain.take", "--held-out", "knocks.take", "-o", "k.yaml"]
    assert app.run(command) == 0
    said = capsys.readouterr()
    table = said.out.splitlines()
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
    assert "the sensor's noise is 4" in said.err
    assert "wrote k.yaml" in said.err
    text = Path("k.yaml").read_text()
    assert text.startswith("ergon: 1\nM: 400.") or text.startswith("ergon: 1\nM: 399.")
    assert "modes:\n  - {M: " in text
    assert "takes:\n  - " in text
    score = "ergon: 1\nkeys:\n  k: {calib: k.yaml}\ngestures:\n  g: '0mm@0 1mm@1 0mm@2'\n"
    Path("s.yaml").write_text(score + "parts:\n  - {key: k, at: 1|1, play: g}\n")
    app.run(["check", "s.yaml"])
    told = capsys.readouterr().err
    assert "k.yaml" not in told, told


def test_json_says_every_number_and_its_deviation(capsys: Capture):
    take("rain.take", rain(KEY), 1, lost=100)
    assert app.run(["metrology", "fit", "rain.take", "--json"]) == 0
    told = records(capsys)
    stages = [record for record in told if record["event"] == "stage"]
    assert [stage["name"] for stage in stages][:2] == ["M K Z", "dry"]
    mode = next(stage for stage in stages if stage["name"] == "mode")
    assert mode["kept"]
    for name, true in (("mass", 0.38), ("dry", 0.05), ("mode_frequency_1", 180.0)):
        found = mode["parameters"][name]
        assert abs(found["value"] - true) < 5 * found["deviation"]
    assert told[-1]["event"] == "measured"


def test_a_take_that_lacks_ticks_is_fitted(capsys: Capture):
    """Nobody knows the forces of a hundredth of the ticks; they are found with the key."""
    gap = set(np.random.default_rng(3).choice(np.arange(200, 6000), 60, replace=False).tolist())
    take("rain.take", rain(KEY, 6.0), 1, gap=gap)
    assert app.run(["metrology", "fit", "rain.take", "--json"]) == 0
    told = records(capsys)
    last = [record for record in told if record["event"] == "stage" and record["kept"]][-1]
    assert last["name"] == "mode"
    assert last["rms_m"] < 4.5e-6
    for name, true in (("mass", 0.38), ("stiffness", 60.0), ("dry", 0.05), ("delay", KEY[6])):
        found = last["parameters"][name]
        assert abs(found["value"] - true) < 4.5 * found["deviation"], name


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["none.take"], "none.take"),
        (["two.take"], "choose by --hand"),
        (["two.take", "--hand", "eve"], "there is no hand 'eve'"),
        (["still.take"], "no force that was sent"),
        (["short.take"], "at least 500 ticks"),
        (["gap.take"], "this take lacks 100 of 1,002 ticks"),
    ],
)
def test_what_cannot_be_measured_is_refused(capsys: Capture, arguments: list[str], told: str):
    take("two.take", rain(KEY, 1.0), 1, hands=2)
    take("still.take", np.zeros(1000), 1)
    take("gap.take", rain(KEY, 1.0), 1, gap=set(range(100, 200)))
    take("short.take", rain(KEY, 0.2), 1)
    assert app.run(["metrology", "fit", *arguments]) == 2
    assert told in capsys.readouterr().err
