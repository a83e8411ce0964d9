"""The pipeline from frames to files, with a simulation whose frames are known."""

import threading
from pathlib import Path

import numpy as np
import pytest
import soundfile

from ergon.exchange.safe import FileRefusedError
from ergon.exchange.wave import hash_samples, read_info
from ergon.exchange.wave_header import Stamp, WaveFormat
from ergon.rendering.ahead import computed_ahead
from ergon.rendering.job import RenderJob
from ergon.rendering.level import Level
from ergon.rendering.render import render_files, stem_paths

N_FRAMES, RATE = 10_000, 44_100
LONG = 60_000  # frames that have a loudness


class Simulation:
    n_out = 2

    def __init__(self, fail_at: int | None = None) -> None:
        self.frame, self.fail_at = 0, fail_at

    def process(self, out: np.ndarray) -> None:
        n = np.arange(self.frame, self.frame + len(out))
        self.frame += len(out)
        if self.fail_at is not None and self.frame > self.fail_at:
            raise ArithmeticError("bell.m went away")
        out[:, 0] = 0.02 * np.sin(0.05 * n)
        out[:, 1] = 0.01 * np.cos(0.031 * n)


class Matrix:
    def __init__(self, matrix: list[list[float]]) -> None:
        self.matrix = np.array(matrix)

    def process(self, frames: np.ndarray, mixed: np.ndarray) -> None:
        mixed[:] = (frames[:, :, None] * self.matrix).sum(axis=1)


class Stage:
    n_frames, rate, n_channels = N_FRAMES, float(RATE), 3
    matrix = ((1.0, 0.5, 0.0), (0.0, 0.5, 1.0))

    def __init__(self, fail_at: int | None = None) -> None:
        self.simulation = Simulation(fail_at)
        self.highpass: list[float | None] = []

    def mixer(self, *, highpass: float | None = None, reference: float | None = None) -> Matrix:
        self.highpass.append(highpass)
        return Matrix([list(row) for row in self.matrix])

    def stems(
        self,
        *,
        highpass: float | None = None,
        reference: float | None = None,
        is_split: bool = False,
    ) -> list[tuple[str, Matrix]]:
        first, second = (list(row) for row in self.matrix)
        silent = [0.0] * 3
        return [("ada", Matrix([first, silent])), ("re mi/2", Matrix([silent, second]))]

    def measured_stems(
        self, *, highpass: float | None = None, reference: float | None = None
    ) -> list[tuple[str, Matrix, float]]:
        return [(name, mixer, 1.0) for name, mixer in self.stems()]


def order(path: Path | str, bits=24, level: Level | None = None, **more: object) -> RenderJob:
    return RenderJob(
        target=str(path),
        format=WaveFormat(RATE, more.pop("n_channels", 3), bits),
        start=more.pop("start", 0),
        stop=more.pop("stop", N_FRAMES),
        level=level or Level(),
        stamp=Stamp("test", "0" * 64),
        **more,
    )


def truth() -> np.ndarray:
    frames = np.zeros((N_FRAMES, 2))
    Simulation().process(frames)
    mixed = np.zeros((N_FRAMES, 3))
    Stage().mixer().process(frames, mixed)
    return mixed


def quiet(_: int) -> None:
    pass


def test_render_float_file_in_physical_units(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    done = render_files(Stage(), order(path, "float"), quiet)
    data, rate = soundfile.read(path, dtype="float32")
    assert rate == RATE
    np.testing.assert_array_equal(data, truth().astype(np.float32))
    assert done.mix.peak == pytest.approx(np.abs(truth()).max(), rel=1e-6)
    assert done.mix.sha256 == hash_samples(path)


@pytest.mark.parametrize("bits", [16, 24])
def test_render_normalised_to_minus_one_db(tmp_path: Path, bits) -> None:
    path = tmp_path / "x.wav"
    target = 10 ** (-1 / 20)
    done = render_files(Stage(), order(path, bits, Level(normalise=target)), quiet)
    data, _ = soundfile.read(path)
    assert np.abs(data).max() == pytest.approx(target, abs=2.0 ** (1 - bits))
    gain = target / np.abs(truth()).max()
    np.testing.assert_allclose(data, truth() * gain, atol=0.51 * 2.0 ** (1 - bits))
    assert done.mix.gain == pytest.approx(gain)


@pytest.mark.parametrize("level", [Level(), Level(normalise=0.5), Level(limit=0.01)])
def test_render_bytes_with_blocks_and_threads(tmp_path: Path, level: Level) -> None:
    files = []
    for index, (block, threads) in enumerate([(4096, 1), (64, 1), (997, 2), (10_000, 8)]):
        path = tmp_path / f"{index}.wav"
        render_files(Stage(), order(path, 24, level, block_frames=block, threads=threads), quiet)
        files.append(path.read_bytes())
    assert len(set(files)) == 1


@pytest.mark.parametrize("level", [Level(), Level(limit=0.01)])
def test_render_excerpt_equals_full_render_samples(tmp_path: Path, level: Level) -> None:
    complete, part = tmp_path / "whole.wav", tmp_path / "part.wav"
    render_files(Stage(), order(complete, "float", level), quiet)
    stage = Stage()
    render_files(stage, order(part, "float", level, start=1234, stop=5000, block_frames=100), quiet)
    want, _ = soundfile.read(complete)
    have, _ = soundfile.read(part)
    np.testing.assert_array_equal(have, want[1234:5000])
    assert stage.simulation.frame <= 5000 + 1000  # not to the end


def test_render_with_limiter_without_delay(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    done = render_files(Stage(), order(path, "float", Level(limit=0.015)), quiet)
    data, _ = soundfile.read(path)
    assert len(data) == N_FRAMES
    assert done.mix.peak <= 0.015 * (1 + 1e-6)
    loud = np.abs(truth()).max(axis=1)
    assert np.corrcoef(data[:, 0], truth()[:, 0])[0, 1] > 0.95
    assert loud.max() > 0.015


@pytest.mark.parametrize(
    "level", [Level(normalise=0.5), Level(loudness=-30.0), Level(loudness=-9.0, limit=0.4)]
)
def test_render_excerpt_at_level_of_piece(tmp_path: Path, level: Level) -> None:
    class Swelling(Stage):
        """Each part has another level."""

        def mixer(self, *, highpass: float | None = None, reference: float | None = None):
            return Swell()

    class Swell:
        n_mixed = 0

        def process(self, frames: np.ndarray, mixed: np.ndarray) -> None:
            size = (np.arange(self.n_mixed, self.n_mixed + len(frames)) / LONG)[:, None]
            Matrix([list(row) for row in Stage.matrix]).process(frames * size, mixed)
            self.n_mixed += len(frames)

    class Long(Swelling):
        n_frames = LONG

    path = tmp_path / "mix.wav"
    done = render_files(Long(), order(path, 24, level, stop=LONG), quiet)
    want, _ = soundfile.read(path)
    for block, start, stop in ((4096, 0, 900), (1000, 7000, 30_000)):
        part = tmp_path / f"{start}.wav"
        cut = render_files(
            Long(),
            order(part, 24, level, start=start, stop=stop, block_frames=block, is_part=True),
            quiet,
        )
        assert cut.mix.gain == done.mix.gain
        np.testing.assert_array_equal(soundfile.read(part)[0], want[start:stop])


@pytest.mark.parametrize("bits", [24, "float"])
@pytest.mark.parametrize("level", [Level(normalise=0.5), Level(limit=0.015)])
def test_render_stems_sum_to_mix(tmp_path: Path, bits, level: Level) -> None:
    path, folder = tmp_path / "mix.wav", tmp_path / "stems"
    done = render_files(Stage(), order(path, bits, level, stems=folder), quiet)
    names = [Path(stem.path).name for stem in done.stems]
    assert names == ["01_ada.wav", "02_re_mi_2.wav"]
    mix, _ = soundfile.read(path)
    stems = [soundfile.read(stem.path)[0] for stem in done.stems]
    assert done.stems[0].gain == done.stems[1].gain == done.mix.gain
    assert level.limit is None or np.abs(truth()).max() > level.limit  # the limiter acts
    np.testing.assert_allclose(sum(stems), mix, atol=3e-7)


def test_render_stems_unclipped_while_mix_cancels(tmp_path: Path) -> None:
    class Cancelling(Stage):
        def mixer(self, *, highpass: float | None = None, reference: float | None = None) -> Matrix:
            return Matrix([[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])

    done = render_files(
        Cancelling(),
        order(tmp_path / "m.wav", 24, Level(normalise=0.5), stems=tmp_path / "s"),
        quiet,
    )
    assert done.mix.peak == pytest.approx(0.5)
    assert max(stem.peak for stem in done.stems) == pytest.approx(0.5)
    assert done.stems[0].gain == done.stems[1].gain < done.mix.gain


def test_render_channel_count_below_and_above_mix(tmp_path: Path) -> None:
    path = tmp_path / "x.wav"
    render_files(Stage(), order(path, "float", n_channels=2), quiet)
    data, _ = soundfile.read(path)
    np.testing.assert_allclose(data[:, 0], truth()[:, 0] + truth()[:, 2], atol=1e-9)
    np.testing.assert_allclose(data[:, 1], truth()[:, 1], atol=1e-9)
    render_files(Stage(), order(path, "float", n_channels=4), quiet)
    data, _ = soundfile.read(path)
    assert data.shape[1] == 4
    assert not data[:, 3].any()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("level", [Level(), Level(normalise=0.5)])
def test_failing_render_leaves_no_file(tmp_path: Path, threads: int, level: Level) -> None:
    n_threads = threading.active_count()
    wanted = order(
        tmp_path / "x.wav", 24, level, threads=threads, stems=tmp_path / "stems", block_frames=100
    )
    with pytest.raises(ArithmeticError, match="bell"):
        render_files(Stage(fail_at=3000), wanted, quiet)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert threading.active_count() == n_threads


@pytest.mark.parametrize("threads", [1, 2])
def test_render_interrupted_leaves_no_file(tmp_path: Path, threads: int) -> None:
    n_threads = threading.active_count()

    def interrupt(done: int) -> None:
        if done >= 500:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_files(
            Stage(), order(tmp_path / "x.wav", threads=threads, block_frames=100), interrupt
        )
    assert list(tmp_path.iterdir()) == []
    assert threading.active_count() == n_threads


def test_render_refuses_foreign_file_before_work(tmp_path: Path) -> None:
    folder = tmp_path / "stems"
    folder.mkdir()
    soundfile.write(folder / "02_re_mi_2.wav", np.zeros(10), RATE)
    stage = Stage()
    with pytest.raises(FileRefusedError, match="02_re_mi_2"):
        render_files(stage, order(tmp_path / "x.wav", stems=folder), quiet)
    assert stage.simulation.frame == 0
    assert not (tmp_path / "x.wav").exists()


def test_render_passes_default_highpass_to_mixer(tmp_path: Path) -> None:
    stage = Stage()
    render_files(stage, order(tmp_path / "x.wav", 24, Level(highpass=8.0)), quiet)
    assert stage.highpass == [8.0]


def test_render_normalised_silence(tmp_path: Path) -> None:
    stage = Stage()
    stage.matrix = ((0.0,) * 3, (0.0,) * 3)
    done = render_files(stage, order(tmp_path / "x.wav", 24, Level(normalise=0.5)), quiet)
    assert done.mix.gain == 1.0
    assert done.mix.peak == 0.0
    assert read_info(tmp_path / "x.wav").n_frames == N_FRAMES


def test_stem_paths_of_instrument_names() -> None:
    names = stem_paths(Path("s"), ["ada", "é.x", "../up"], ".wav")
    assert [path.name for path in names] == ["01_ada.wav", "02_é.x.wav", "03_.._up.wav"]


def test_ahead_iterator_order_and_exceptions() -> None:
    n_threads = threading.active_count()
    assert list(computed_ahead(iter(range(100)))) == list(range(100))

    def broken():
        yield 1
        yield 2
        raise ZeroDivisionError

    coming = computed_ahead(broken())
    assert [next(coming), next(coming)] == [1, 2]
    with pytest.raises(ZeroDivisionError):
        next(coming)

    def endless():
        n = 0
        while True:
            yield n
            n += 1

    coming = computed_ahead(endless())
    assert next(coming) == 0
    coming.close()
    assert threading.active_count() == n_threads
