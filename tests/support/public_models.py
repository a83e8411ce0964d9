"""Published models of others, imported and compared with the interpreters of `oracle`.

    PYTHONPATH=tests/support:. .venv/bin/python -m public_models FOLDER… [--seconds 1]

Every model below the folders (.mdl, .dsp with a MIMS script, .xml, and lists of messages to pmpd
in .txt) gets a test signal at each input. A line gives the time that it was played, and its
error: the largest error over the largest value of its channel. `--dialect` and `--laws` are
those of `ergon import`, for files that several dialects can read.
"""

import argparse
import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from imported import rendered
from models_compared import miphysics_off, off, pmpd_off, sam_off
from numpy.typing import NDArray
from oracle import mims

from ergon.common.errors import ErgonError
from ergon.scores.staging.refusals import StageError
from ergon.workshop.api.model import ImportedModel, ModelOptions, import_model
from ergon.workshop.models.errors import DialectError, ModelError
from ergon.workshop.models.mims.reading import read_text
from ergon.workshop.models.pmpd.reading import is_list

RATE = mims.RATE
AGREES = 1e-5  # -100 dB
ENDS = (".mdl", ".dsp", ".xml")
Signals = Mapping[str, NDArray[np.float64]]


def signals(text: str, names: tuple[str, ...], n_frames: int) -> Signals:
    """A signal for each input, as files store it: a path, a push, or the value of a parameter."""
    t = np.arange(n_frames) / RATE
    source = {
        "posInput": 0.01 * np.sin(2 * np.pi * 9.0 * t) ** 2,
        "frcInput": 1e-4 * np.sin(2 * np.pi * 300.0 * t),
        "audioParam": 0.5 - 0.4 * np.cos(2 * np.pi * 3.0 * t),
    }
    result = {}
    for name in names:
        message = re.search(rf"(audioParam)\s+@?{name}\b|@{name}\s+(\w+)", text)
        word = message[1] or message[2] if message else "posInput"  # of ports and inlets
        result[name] = np.float64(np.float32(source[word]))
    return result


def _read(path: Path, options: ModelOptions, fallback: ModelOptions) -> ImportedModel:
    """A model in the dialect that can read it, or in that of the fallback if several can."""
    try:
        return import_model(path, options)
    except DialectError:
        return import_model(path, replace(fallback, inputs=options.inputs))


def compared(path: Path, seconds: float, fallback: ModelOptions) -> tuple[str, float]:
    """The dialect of a model and its error. Raises ErgonError."""
    options = ModelOptions(laws=fallback.laws)
    text = read_text(path)
    built = _read(path, options, fallback)
    n_frames = round(seconds * RATE)
    if built.dialect == "miphysics":
        # If links turn, the dampers of a score feel the step along the line.
        return "miphysics", miphysics_off(text, n_frames, along=True)
    fed = signals(text, built.unfed, n_frames)
    for name, samples in fed.items():
        soundfile.write(f"{name}.wav", samples, RATE, subtype="FLOAT")
    if built.dialect == "pmpd" or built.dialect == "pmpd~":
        return built.dialect, pmpd_off(text, built.dialect, n_frames, fed)
    if built.dialect == "sam":
        return "sam", sam_off(text, seconds, fed)
    inputs = {name: f"{name}.wav" for name in fed}
    built = _read(path, replace(options, inputs=inputs), fallback)
    exact = mims.played(text, built.dialect, seconds, fallback.laws, inputs=fed)
    return built.dialect, off(rendered(built.text, seconds), exact)


def _result(do: Callable[[], tuple[str, float]]) -> tuple[str, str]:
    """The result for a model, in a word and in a sentence."""
    try:
        dialect, error = do()
    except ModelError as error:
        return "refused", f"line {error.line}: {error}"
    except StageError as error:
        return "not played", str(error.diagnostics[0].message)
    except ErgonError as error:
        return "not played", str(error)
    except (ArithmeticError, AssertionError, LookupError, ValueError) as error:
        return "not compared", f"{type(error).__name__}: {error}"
    return ("agrees" if error <= AGREES else "is off"), f"{dialect}, {error:.1e}"


def _models(folders: list[str]) -> Iterator[Path]:
    for folder in folders:
        for path in sorted(Path(folder).resolve().rglob("*")):
            is_text = path.suffix == ".txt" and is_list(path.read_text(errors="replace"))
            if path.suffix in ENDS or is_text:
                yield path


def main(arguments: list[str]) -> None:
    """Compare all models, with a line for each, then count the results."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+")
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--dialect", choices=["v1", "v2"], default="v2")
    parser.add_argument("--laws", choices=["head", "2019"], default="head")
    asked = parser.parse_args(arguments)
    fallback = ModelOptions(dialect=asked.dialect, laws=asked.laws)
    models, counts = list(_models(asked.folders)), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the score of a model and what feeds it stand in one folder
        for path in models:
            word, sentence = _result(lambda path=path: compared(path, asked.seconds, fallback))
            counts[word] += 1
            print(f"{word}\t{path.name}\t{sentence}", flush=True)
    print(", ".join(f"{n} {word}" for word, n in counts.most_common()), f"over {asked.seconds:g} s")


if __name__ == "__main__":
    main(sys.argv[1:])
