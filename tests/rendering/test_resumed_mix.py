"""An edit late in a piece: mixer and meters go on from the states that an earlier render stored."""

from pathlib import Path

import numpy as np
import pytest

import ergon
from ergon.api.options import FileOptions
from ergon.rendering import memory, resumed, stretches
from ergon.rendering.job import RenderedFiles
from ergon.rendering.level import FrameSpool
from ergon.rendering.memory import ComputedRender

_BELL = """\
    modules:
      m: {CEL: {M: 2g, f: %dHz, t60: 0.5s}}
      h: {CEL: {M: 3g, f: 1Hz, t60: 0.3s}}
      b: {BUT: {between: [h, m], K: 9e3N/m, Z: 0.1Ns/m, gap: 0.2mm}}
    out: {SOA: m}
"""
_SCORE = f"""\
ergon: 1
rates: {{audio: 8kHz}}
accuracy: {{error: -40dB}}
instruments:
  high:
{_BELL % 700}\
  low:
{_BELL % 300}\
  idle:
{_BELL % 400}\
  rain: {{BANK: {{count: 12, f: 90Hz..900Hz, t60: 1s, M: 1g}}, out: {{SOX: rain.all}}}}
strikes:
  first: {{to: high.h, at: 0.1s, impulse: 2mNs}}
  last: {{to: high.h, at: 2.9s, impulse: 2mNs}}
  other: {{to: low.h, at: 0.3s, impulse: 2mNs}}
  drops: {{to: rain.all, at: 0s, for: 3s, rate: 4Hz, impulse: 1uNs..9uNs}}
mix:
  channels: 2
  rooms: {{hall: {{t60: {{200Hz: 1s, 2kHz: 0.6s}}, size: 5m}}}}
  route:
    - {{from: high, to: 1, send: {{hall: -9dB}}, lowpass: 2kHz}}
    - {{from: low, to: [1, 2], highpass: 40Hz, delay: {{time: 50ms, feedback: -6dB}}, pan: 0.2}}
    - {{from: idle, to: 2, highpass: 40Hz}}
    - {{from: rain, to: [1, 2], fade: [{{at: 0s, gain: -12dB}}, {{at: 3s, gain: 0dB}}]}}
  master: {{MASTER}}
render: {{TAIL}}
"""


@pytest.fixture
def n_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The frames before the first one that each render computes, with stretches of 4,096."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", 4096)
    monkeypatch.setattr(stretches, "_NS_PER_SAMPLE", 0.0)
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(memory, "_WORK_SECONDS_MIN", 0.0)
    known: list[int] = []
    finish = ComputedRender.finish

    def finish_and_note(computing: ComputedRender, *of: object) -> None:
        known.append(computing.n_known)
        finish(computing, *of)  # type: ignore[arg-type]

    monkeypatch.setattr(ComputedRender, "finish", finish_and_note)
    return known


def rendered(text: str, saved: str, patch: pytest.MonkeyPatch, **options: object) -> RenderedFiles:
    Path("a.yaml").write_text(text)
    patch.setenv("ERGON_CACHE", saved)
    file_options = FileOptions(force=True, **options)  # type: ignore[arg-type]
    return ergon.render_to_file("a.yaml", "a.wav", file_options)


def score(master: str, tail: str) -> str:
    return _SCORE.replace("{MASTER}", f"{{{master}}}").replace("{TAIL}", f"{{tail: {tail}}}")


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("master", "tail"),
    [("normalise: -1dB", "1s"), ("loudness: -30LUFS, limit: -6dB", "auto"), ("limit: -20dB", "9s")],
)
def test_late_edit_resumes_mix(
    master: str, tail: str, threads: int, n_known: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = score(master, tail)
    rendered(text, "on", monkeypatch, threads=threads)
    for edits in (("2.9s", "2.8s"), ("2.8s", "3.1s")):
        text = text.replace(*edits)
        done = rendered(text, "on", monkeypatch, threads=threads)
        wanted = rendered(text, "off", monkeypatch, threads=threads)
        assert done.mix == wanted.mix
        assert done.instruments == wanted.instruments
    before = int(2.8 * 8000) // 4096 * 4096
    assert n_known == [0, before, before]


def test_late_edit_after_another_gain_resumes_mix(
    n_known: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The levels of the instruments are those of the first render, in which the gain differed."""
    text = score("normalise: -1dB", "1s")
    rendered(text, "on", monkeypatch)
    text = text.replace("gain: 0dB", "gain: 3dB")
    rendered(text, "on", monkeypatch)
    text = text.replace("2.9s", "3.0s")
    done, wanted = rendered(text, "on", monkeypatch), rendered(text, "off", monkeypatch)
    assert (done.mix, done.instruments) == (wanted.mix, wanted.instruments)
    assert n_known[-1] > 4 * 4096


def test_late_edit_with_changed_silent_route_equals_fresh_render(
    n_known: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mixer has a place for the state of each route, of silent ones too."""
    text = score("normalise: -1dB", "1s")
    rendered(text, "on", monkeypatch)
    text = text.replace("2.9s", "3.0s").replace("from: idle, to: 2", "from: idle, to: [1, 2]")
    done, wanted = rendered(text, "on", monkeypatch), rendered(text, "off", monkeypatch)
    assert (done.mix, done.instruments) == (wanted.mix, wanted.instruments)


def test_damaged_states_are_computed_again(
    n_known: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = score("normalise: -1dB", "1s")
    rendered(text, "on", monkeypatch)
    for path in (tmp_path / "cache/ergon/stretches").iterdir():
        data = bytearray(path.read_bytes())
        data[-1] ^= 1
        path.write_bytes(data)
    text = text.replace("2.9s", "3.0s")
    done, wanted = rendered(text, "on", monkeypatch), rendered(text, "off", monkeypatch)
    assert (done.mix, done.instruments) == (wanted.mix, wanted.instruments)
    assert n_known == [0, 0]


@pytest.mark.parametrize("n_bytes", [0, 1000, 1 << 20])
def test_frame_spool_in_memory_and_on_disk(n_bytes: int, tmp_path: Path) -> None:
    frames = np.random.default_rng(1).standard_normal((1000, 3))
    with FrameSpool(tmp_path, 3, n_bytes) as spool:
        for first_frame in range(0, 1000, 10):
            spool.take(frames[first_frame : first_frame + 10])
        assert np.array_equal(np.concatenate(list(spool.blocks(10))), frames)
        assert (spool.peak, spool.n_frames) == (np.abs(frames).max(), 1000)
