"""Renders that are read again: sound files, and folders of frozen parts."""

from __future__ import annotations

import hashlib
import io
import random
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
from corrupted import corrupted

from ergon.common import sound_files
from ergon.exchange import frozen, sound, wave
from ergon.exchange.frozen import NotFrozenError
from ergon.exchange.wave_header import Bits, NotWaveError, Stamp, WaveFormat, pack
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged

N_FRAMES = 50
TAPS = {"bell": (0, 2), "gong": (1,)}
WORDS = ('"stems":', '"file":', '"outputs":', "[", "]", "{", "}", "null", "true", '"\\u0000"')


def _render(format: WaveFormat, suffix: str = sound_files.WAVE) -> bytes:
    file = io.BytesIO()
    stamp = Stamp("a bell", "0" * 64, "1" * 64)
    writer = sound.writer(f"render{suffix}", file, format, N_FRAMES, stamp)
    samples = np.arange(N_FRAMES * format.n_channels).reshape(N_FRAMES, -1)
    floats = {"float": "<f4", "double": "<f8"}
    writer.write(samples.astype(floats.get(str(format.bits), "<i4")))
    writer.close()
    return file.getvalue()


@cache
def renders(suffix: str) -> list[bytes]:
    bits: tuple[Bits, ...] = (16, 24) if suffix == sound_files.FLAC else (16, 24, "float", "double")
    built = [_render(WaveFormat(44_100, 2, own), suffix) for own in bits]
    if suffix == sound_files.WAVE:
        large, samples = WaveFormat(48_000, 3, 24), bytes(N_FRAMES * 9)
        built.append(pack(large, N_FRAMES, Stamp("a bell"), riff_limit=0) + samples)
    return built


def _case(suffix: str) -> Callable[[random.Random], bytes]:
    def case(chance: random.Random) -> bytes:
        whole = chance.choice(renders(suffix))
        return next(corrupted(whole, 1, chance.randrange(1 << 30), *renders(suffix)))

    return case


def reader(suffix: str) -> Callable[[bytes, Path], Iterator[str]]:
    def read(data: bytes, folder: Path) -> Iterator[str]:
        path = folder / f"render{suffix}"
        path.write_bytes(data)
        wave.is_render(path)
        info = sound.read_info(path)
        yield from (info.title, str(info.score), str(info.plan))
        assert sum(len(block) for block in sound.read_blocks(path)) == info.n_frames
        sound.digest_samples(path)

    return read


@cache
def frozen_parts() -> tuple[str, dict[str, bytes]]:
    """The manifest of a folder of frozen parts, and its sound files by name."""
    files = {
        f"{part}.wav": _render(WaveFormat(44_100, len(taps), "double"))
        for part, taps in TAPS.items()
    }
    n_bytes = {name: 8 * N_FRAMES * len(TAPS[name[:-4]]) for name in files}
    stems = tuple(
        frozen.Stem(
            name[:-4],
            Path(name),
            TAPS[name[:-4]],
            hashlib.sha256(data[-n_bytes[name] :]).hexdigest(),
        )
        for name, data in files.items()
    )
    source = frozen.Source("a bell", "0" * 64, 7, 44_100.0, "1", "1" * 64)
    return frozen.manifest_text(frozen.Frozen(source, N_FRAMES, stems)), files


def _folder(chance: random.Random) -> dict[str, bytes]:
    manifest, files = frozen_parts()
    if chance.random() < 0.7:
        manifest = damaged(manifest, chance, WORDS)
    result = {frozen.MANIFEST_NAME: manifest.encode(errors="replace")}
    for name, complete in files.items():
        is_hit = chance.random() < 0.3
        result[name] = (
            next(corrupted(complete, 1, chance.randrange(1 << 30))) if is_hit else complete
        )
    return result


def read_folder(case: dict[str, bytes], folder: Path) -> Iterator[str]:
    for name, data in case.items():
        (folder / name).write_bytes(data)
    content = frozen.read(folder)
    yield " ".join(content.parts)
    for stem in frozen.check(content, TAPS, N_FRAMES):
        assert stem.samples().shape == (N_FRAMES, len(stem.taps))


TARGETS = (
    *(
        Target(f"render{suffix}", _case(suffix), reader(suffix), (NotWaveError,), 150)
        for suffix in sound_files.SUFFIXES
    ),
    Target("frozen parts", _folder, read_folder, (NotFrozenError,), 100),
)
