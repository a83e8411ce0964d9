"""The ergon stream and the marks, read back by the csv and json modules."""

import csv
import json

import numpy as np

from ergon.exchange.markers import markers_csv
from ergon.exchange.stream import COLUMN_NAMES, ErgonNames, stream_header, stream_rows

ERGONS = {
    "time": np.array([0.1, 1 / 3, 2.0]),
    "mat": np.array([0.0, 4.0, 0.0]),
    "mass": np.array([4e-5, 4e-5, 4e-5]),
    "speed": np.array([100.0, -250.0, 1e-3]),
    "impulse": np.array([4e-3, -1e-2, 4e-8]),
    "source": np.array([0.0, 1.0, 0.0]),
}
NAMES = ErgonNames(
    ["k1", "", "", "", "bell.m, left"].__getitem__, ["a.yaml:3:5", "b.yaml:7:1"].__getitem__
)
HASH = "0" * 64


def test_stream_csv_round_trip_to_the_bit() -> None:
    text = stream_header("csv", title="Two\nlines", rate=44_100.0, score=HASH) + stream_rows(
        "csv", ERGONS, NAMES
    )
    about, *lines = text.splitlines()
    assert about == f"# ergon stream 1, made by ergon, 44100 Hz, score {HASH}, Two lines"
    read = list(csv.DictReader(lines))
    assert tuple(read[0]) == COLUMN_NAMES
    assert [float(row["time [s]"]) for row in read] == ERGONS["time"].tolist()
    assert [row["struck"] for row in read] == ["k1", "bell.m, left", "k1"]
    assert [row["sign"] for row in read] == ["+", "-", "+"]
    assert [float(row["speed [m/s]"]) for row in read] == [100.0, 250.0, 1e-3]
    assert [float(row["impulse [N·s]"]) for row in read] == [4e-3, 1e-2, 4e-8]
    assert read[1]["source"] == "b.yaml:7:1"


def test_stream_as_json_lines() -> None:
    text = stream_header("json", title="t", rate=48_000.0, score=HASH) + stream_rows(
        "json", ERGONS, NAMES
    )
    about, *lines = [json.loads(line) for line in text.splitlines()]
    assert (about["v"], about["event"], about["rate_hz"]) == (1, "stream", 48_000.0)
    assert lines[1] == {
        "time_s": 1 / 3,
        "struck": "bell.m, left",
        "sign": "-",
        "mass_kg": 4e-5,
        "speed_m_s": 250.0,
        "impulse_n_s": 1e-2,
        "source": "b.yaml:7:1",
    }


def test_stream_marks_csv() -> None:
    text = markers_csv([("A", "1|1", 0.0), ('so "far"', "9|2.5", 33.25)])
    rows = list(csv.reader(text.splitlines()[1:]))
    assert rows == [
        ["name", "bar|beat", "time [s]"],
        ["A", "1|1", "0.000000"],
        ['so "far"', "9|2.5", "33.250000"],
    ]
