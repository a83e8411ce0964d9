"""Files beside a score: takes, plans, records of trials, devices.toml, calibrations, layouts."""

from __future__ import annotations

import io
import itertools
import os
import random
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from corrupted import corrupted
from one_bell import SCORE as BELL

from ergon import _core
from ergon.exchange import plan_file
from ergon.live import boards, calibration
from ergon.live.boards import BoardError
from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage
from tests.fuzz.harness import Target
from tests.fuzz.score_targets import checked
from tests.fuzz.texts import damaged
from tests.scores.test_corrupted_takes import FORMATS, MEANT, internal

LIBRARY = Path(__file__).parents[2] / "scores" / "library"


def _take(suffix: str) -> Target:
    others = [data for every in FORMATS.values() for data in every]

    def case(chance: random.Random) -> bytes:
        whole = chance.choice(FORMATS[suffix])
        return next(corrupted(whole, 1, chance.randrange(1 << 30), *others))

    return Target(f"take{suffix}", case, partial_take(suffix), MEANT, 80)


def partial_take(suffix: str) -> Any:
    """A reader of takes in a format."""
    from ergon.cli.console import Console
    from ergon.cli.take_info import take as take_info

    def read(data: bytes, folder: Path) -> list[str]:
        import contextlib

        path = folder / f"hand{suffix}"
        path.write_bytes(data)
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            result = internal(path, lambda path: take_info(Console(json=True), path))
        assert not result, result
        return [output.getvalue()]

    return read


@cache
def _bell() -> Any:
    loaded = load("bell.yaml", text=BELL)
    assert loaded.piece is not None
    return loaded.piece


@cache
def _plan_text() -> str:
    plan = stage(_bell(), planned=True).plan
    assert plan is not None
    return plan_file.plan_text(plan.choices(), plan.hash, budget={"error": -60.0})


PLAN_WORDS = (
    "[",
    "]",
    "{",
    "}",
    ",",
    '"choices":',
    '"ergon_plan": 2',
    '"budget":',
    "true",
    "null",
    "4294967295",
)


def _plan(chance: random.Random) -> str:
    if chance.random() < 0.3:
        choices = [
            [chance.choice((1, 2, 0, 1 << 31, (1 << 32) - 1)) for _ in range(3)]
            + [[[chance.randrange(4) for _ in range(chance.randrange(4))] for _ in range(2)]]
            + [chance.choice((None, 0, 1, (1 << 32) - 1))]
            for _ in range(chance.randrange(4))
        ]
        return plan_file.plan_text(choices, "0")  # type: ignore[arg-type]
    return damaged(_plan_text(), chance, PLAN_WORDS)


def _read_plan(text: str, folder: Path) -> Iterator[str]:
    path = folder / "plan.json"
    path.write_bytes(text.encode(errors="replace"))
    choices = plan_file.read(path).choices
    try:
        stage(_bell(), planned=True, pins=choices)
    except StageError as error:
        yield str(error)


class _Records:
    """A store of trials that gives the same records again and again, whatever is asked for."""

    def __init__(self, records: list[_core.TrialRecord]) -> None:
        self._records = itertools.cycle([*records, None])

    def get(self, key: str) -> _core.TrialRecord | None:
        return next(self._records)

    def put(self, key: str, record: _core.TrialRecord) -> None:
        pass

    def forget(self) -> None:
        pass


def _trials(chance: random.Random) -> list[_core.TrialRecord]:
    """Records that a stranger may have left: any numbers, as many as there are or others."""
    sizes = (0.0, -1.0, -60.0, 1e-3, 0.5, 1e300, None, None)
    counts = (0, 1, 2, 3, 4, 8, 64, 1 << 31, (1 << 32) - 1)
    return [
        _core.TrialRecord(
            [chance.choice(sizes) for _ in range(chance.choice((0, 3, 9, 10, 11)))],
            [[0], *([chance.choice(counts) for _ in range(chance.choice((1, 3)))] for _ in "ab")][
                : chance.randrange(4)
            ],
            chance.choice(
                (None, None, "it has a contact, a law, a proxy or a mass that follows", "why")
            ),
        )
        for _ in range(chance.randint(1, 5))
    ]


def _read_trials(records: list[_core.TrialRecord], _: Path) -> None:
    built = stage(_bell(), planned=True, store=_Records(records)).plan
    assert built is not None
    built.rows()


DEVICES = """\
# mine
[devices]
tgr0 = "frame:/dev/ttyACM0"
left = "haply:127.0.0.1:10001?id=A14"

[calibration."frame:/dev/ttyACM0#0"]
sign = 1
zero = 0.001
gain = 1.02
range = [-0.01, 0.01]
force_max = 10.0

[calibration."haply:A14#1"]
sign = -1
zero = 0.0
gain = -1.0
range = [-0.1, 0.1]
force_max = 3
"""
DEVICE_WORDS = ("[calibration]", "[[devices]]", "sign = true", "inf", "nan", "[[1]]", '"', "'''")


def _devices(chance: random.Random) -> str:
    return damaged(DEVICES, chance, DEVICE_WORDS)


def _read_devices(text: str, folder: Path) -> None:
    before = os.environ.get("XDG_CONFIG_HOME")
    os.environ["XDG_CONFIG_HOME"] = str(folder)
    path = folder / "ergon" / "devices.toml"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(text.encode(errors="surrogatepass"))
    axis = calibration.AxisCalibration(1, 0.0, 1.0, (-0.01, 0.01), 5.0)
    try:
        urls = [*boards.device_urls().values(), "frame:/dev/ttyACM0", "haply:127.0.0.1:1?id=A14"]
        for url in urls[:6]:
            calibration.stored_calibrations(url)
            calibration.calibrated_axes(url)
        calibration.store_axis("frame:/dev/ttyACM0", 0, axis)
        assert calibration.stored_calibrations("frame:/dev/ttyACM0")[0] == axis
    finally:
        if before is None:
            del os.environ["XDG_CONFIG_HOME"]
        else:
            os.environ["XDG_CONFIG_HOME"] = before


CALIBRATED = BELL.replace("M: 400g, K: 60N/m, Z: 1.2Ns/m", "calib: other.yaml")
LAID_OUT = BELL.replace("mix: {channels: 2", "mix: {layout: other.yaml, channels: 2")


def _beside(file: str) -> Any:
    text = (LIBRARY / file).read_text("utf-8")
    known = (
        "speakers:",
        "[0m, 1m]",
        "[",
        "]",
        "M: 1g",
        "K: 1N/m",
        "Z:",
        "title:",
        "ergon: 1",
        "- ",
    )
    return lambda chance: damaged(text, chance, known)


def _read_beside(score: str) -> Any:
    return lambda text, folder: checked(
        str(folder / "s.yaml"), score, {str(folder / "other.yaml"): text}
    )


TARGETS = (
    *(_take(suffix) for suffix in FORMATS),
    Target("plans", _plan, _read_plan, (plan_file.NotPlanError,), 150),
    Target("trial records", _trials, _read_trials, (), 3, 5_000),
    Target("devices.toml", _devices, _read_devices, (BoardError,), 300),
    Target(
        "calibrations", _beside("calib/crm-key-03.yaml"), _read_beside(CALIBRATED), (), 60, 50_000
    ),
    Target("layouts", _beside("layouts/stereo.yaml"), _read_beside(LAID_OUT), (), 60, 50_000),
)
