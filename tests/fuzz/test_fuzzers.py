"""Every reader of the table, for a while in `make test`, for long in `make test-long`."""

import math
import os
import random
from itertools import islice
from pathlib import Path

import pytest

from ergon.common import sound_files
from ergon.exchange.frozen import MANIFEST_NAME
from tests.fuzz.harness import Target, fuzz
from tests.fuzz.model_targets import models, read
from tests.fuzz.render_targets import frozen_parts, read_folder, reader, renders
from tests.fuzz.targets import BY_NAME, TARGETS
from tests.scores.test_corrupted_takes import FORMATS

SHORT_PARTS = 2  # a landing runs one of them; the long run has every case
NAMES = [target.name for target in TARGETS]
# Each long run has cases of its own; FUZZ_FROM repeats those of another.
FIRST = int(os.environ.get("FUZZ_FROM") or random.SystemRandom().randrange(10**9))


def holds(target: Target, count: int, folder: Path, first: int = 0) -> None:
    outcome = fuzz(target, count, folder, first)
    print(f"{target.name} from {first}: {outcome}")
    assert not outcome.faults, str(outcome)


@pytest.mark.parametrize("name", NAMES)
def test_reader_fuzzing_short(name: str, tmp_path: Path) -> None:
    target = BY_NAME[name]
    holds(target, math.ceil(target.short / SHORT_PARTS), tmp_path, target.short_first)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_reader_fuzzing_long(name: str, tmp_path: Path) -> None:
    target = BY_NAME[name]
    holds(target, target.long, tmp_path, FIRST)


def test_readers_accept_undamaged_renders_and_frozen_parts(tmp_path: Path) -> None:
    for suffix in sound_files.SUFFIXES:
        for data in renders(suffix):
            assert next(reader(suffix)(data, tmp_path)) == "a bell"
    manifest, files = frozen_parts()
    complete = {MANIFEST_NAME: manifest.encode(), **files}
    assert list(read_folder(complete, tmp_path)) == ["bell gong"]


def test_reader_accepts_undamaged_models(tmp_path: Path) -> None:
    for text in models():
        (score,) = read((".txt", text), tmp_path)
        assert "instruments:" in score


def cut_or_flipped(data: bytes):
    """Every beginning of a file, then the file with each of its bits the other way."""
    yield from (data[:end] for end in range(len(data)))
    for bit in range(8 * len(data)):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        yield bytes(flipped)


def every_damage(suffix: str, folder: Path, every: int) -> None:
    target = BY_NAME[f"take{suffix}"]
    for data in FORMATS[suffix]:
        for damaged in islice(cut_or_flipped(data), 0, None, every):
            target.read(damaged, folder)


@pytest.mark.parametrize("suffix", FORMATS)
def test_take_reader_with_some_cuts_and_flipped_bits(suffix: str, tmp_path: Path) -> None:
    every_damage(suffix, tmp_path, 97)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", FORMATS)
def test_take_reader_with_all_cuts_and_flipped_bits(suffix: str, tmp_path: Path) -> None:
    every_damage(suffix, tmp_path, 1)
