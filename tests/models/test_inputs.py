"""Inputs of models that files feed, and the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from commands import records
from oracle import mims

from ergon.api.errors import OptionError
from ergon.api.model import ModelOptions, import_model
from ergon.cli import app
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import Stamp, WaveFormat

FRAMES = 4410
pytestmark = pytest.mark.usefixtures("own_folder")
HAND = """
@in1 posInput 0
@in2 frcInput @m
@m mass 1 0.01 0
@g ground 0
@s springDamper @g @m 0.01 0.001
@c springDamper @in1 @m 0.02 0.003
@out1 posOutput @m
@out2 posOutput @in1
"""


def wave(path: Path, samples: np.ndarray, rate: int = mims.RATE) -> None:
    block = samples.reshape(len(samples), -1)
    form = WaveFormat(rate, block.shape[1], "float")
    with path.open("wb") as file:
        writer = WaveWriter(file, form, len(samples), Stamp())
        writer.write(block)
        writer.close()


def path_and_push() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(FRAMES) / mims.RATE
    path = 0.01 * np.sin(2 * np.pi * 90.0 * t) ** 2
    return path.astype("f4"), (1e-4 * np.sin(2 * np.pi * 300.0 * t)).astype("f4")
