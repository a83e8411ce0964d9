"""Models of other programs, of each dialect, with damage."""

from __future__ import annotations

import random
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from ergon.api.errors import OptionError
from ergon.workshop.api.model import ModelOptions, import_model
from ergon.workshop.models.errors import DialectError, ModelError
from tests.fuzz.harness import Target
from tests.fuzz.texts import NUMBERS, damaged
from tests.models.test_miphysics import link, mass, model
from tests.models.test_pmpd import FED
from tests.models.test_sam import WRITTEN

MIMS = """\
@kScale param 0.5
@g ground 0
@m mass 1.2 0 0.1
@c osc 1 0.01 0.001 0 0
@s string 5 1 [0.1*kScale] 0.01 0 0
@b spring @m @c 0.05
@n contact @m @c 0.1 0.01
@p mesh 3 3 1 0.1 0.01 0 0
@in1 frcInput @m
@out1 posOutput [@s 0.5]
"""
SUFFIXES = (".txt", ".mdl", ".xml")
WORDS = ("@m", "[", "]", "(", ")", "mass", "spring", "link", "exp(", "9" * 400, "hslider(", "1/0")


@cache
def models() -> tuple[str, ...]:
    parts = (
        mass("a", 1.0, (0, 0, 0.1)),
        mass("b", 2.0, (0, 0, 0.2)),
        link("SpringDamper3D", "a", "b", 0.1, 0.01, 0.0),
    )
    return MIMS, FED, WRITTEN, model(*parts)


def _case(chance: random.Random) -> tuple[str, str]:
    words = (*WORDS, *NUMBERS)
    return chance.choice(SUFFIXES), damaged(chance.choice(models()), chance, words)


def read(case: tuple[str, str], folder: Path) -> Iterator[str]:
    suffix, text = case
    path = folder / f"a{suffix}"
    path.write_bytes(text.encode(errors="replace"))
    yield import_model(path, ModelOptions(), beside=folder).text


TARGETS = (Target("models", _case, read, (ModelError, DialectError, OptionError), 60, 20_000),)
