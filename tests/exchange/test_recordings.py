"""Recordings of live hands: the layout as docs/takes.md has it, and how a score plays them."""

import struct
from pathlib import Path

import numpy as np
import pytest
from recordings import END, EVENTS, HEADER, ROWS, Axis, chunk, chunks, end, event, header, row, rows

from ergon import _core
from ergon.exchange.recording import NotRecordingError, positions_from_start
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

HANDS = (("rémi", "k2"), ("ada", "k1"))
EVERY = [
    (tick, (Axis(1e-3 * tick, -0.5 * tick, 0.25, 3, 7 * tick), Axis(2e-3, 0.1 * tick, -1.5, 25, 9)))
    for tick in (100, 101, 103, 104)
]
BODY = [row(tick, *axes) for tick, axes in EVERY]


def saved(tmp_path: Path, *parts: bytes) -> Path:
    path = tmp_path / "hand.take"
    path.write_bytes(b"".join(parts))
    return path


def test_read_recording_fields_from_bytes(tmp_path: Path) -> None:
    line = '{"gain": 0.5}'
    events = chunk(EVENTS, event(101, line) + event(104, "{}"))
    path = saved(
        tmp_path,
        header(HANDS, 48000.0, 48, '{"day": "2026-11-20"}'),
        rows(*BODY[:3]),
        events,
        rows(BODY[3]),
        end(5),
    )
    result = _core.read_recording(path)
    assert (result.rate, result.frames, result.axes) == (48000.0, 48, list(HANDS))
    assert result.names == ["rémi", "ada"]
    assert result.about == '{"day": "2026-11-20"}'
    assert result.events == [(101, line), (104, "{}")]
    assert (result.dropped, result.lost_bytes, result.is_complete, result.finished) == (
        5,
        0,
        True,
        True,
    )
    assert result.damage is None
    assert result.duration == pytest.approx(5 / 1000)
    assert result.ticks().tolist() == [100, 101, 103, 104]
    columns = [
        result.positions(),
        result.forces(),
        result.sent(),
        result.flags(),
        result.clocks(),
    ]
    for i, column in enumerate(columns):
        assert column.tolist() == [[axis[i] for axis in axes] for _, axes in EVERY]
    held = [axes[0].position for _, axes in (EVERY[0], EVERY[1], EVERY[1], *EVERY[2:])]
    assert result.held()[:, 0].tolist() == held


def test_recording_to_bytes_layout(tmp_path: Path) -> None:
    ticks = np.array([5, 6, 9], dtype=np.uint64)
    x = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    built = _core.Recording(44100.0, 44, HANDS, '{"a": 1}', ticks, x)
    head, body, last = chunks(built.to_bytes())
    assert head == chunks(header(HANDS, 44100.0, 44, '{"a": 1}'))[0]
    flat = [row(t, *map(Axis, each)) for t, each in zip([5, 6, 9], x.tolist(), strict=True)]
    assert body == (ROWS, b"".join(flat))
    assert last == (END, bytes(8))
    assert head[0] == HEADER


@pytest.mark.parametrize(
    ("ticks", "x", "words"),
    [
        ([1, 1], [[0.0], [0.0]], "ticks must rise"),
        ([1], [[0.0], [0.0]], "one position for each tick"),
        ([1, 2], [[0.0, 1.0], [0.0, 1.0]], r"positions must be \(n_frames, 1\)"),
    ],
)
def test_recording_of_inconsistent_rows_is_refused(
    ticks: list[int], x: list[list[float]], words: str
) -> None:
    with pytest.raises(_core.EngineError, match=words):
        _core.Recording(44100.0, 44, [("a", "")], "", np.array(ticks, dtype=np.uint64), np.array(x))


def test_take_of_recording_by_channel(tmp_path: Path) -> None:
    path = saved(tmp_path, header(HANDS), rows(*BODY), end())
    for channel in ("rémi", "k2"):
        take = read(path, channel)
        assert take.x.tolist() == [axes[0].position for _, axes in EVERY]
        assert take.t == pytest.approx(np.array([0, 1, 3, 4]) * 44 / 44100, abs=1e-15)
        assert take.damage is None
    assert read(path, "ada").x.tolist() == [2e-3] * 4
    with pytest.raises(TakeError, match="write `channel` as one of rémi, ada"):
        read(path)
    with pytest.raises(TakeError, match="no channel 'remi'") as caught:
        read(path, "remi")
    assert caught.value.suggestion == "rémi"
    assert caught.value.field == "channel"
    with pytest.raises(TakeError, match="remove `rate`"):
        read(path, "ada", rate=1000.0)
    alone = saved(tmp_path, header(), *(rows(row(t, Axis(0.0))) for t in (1, 2)), end())
    assert read(alone).x.tolist() == [0.0, 0.0]


def test_recording_channels_of_hand_on_several_keys(tmp_path: Path) -> None:
    path = saved(tmp_path, header((("remi", "k1"), ("remi", "k2"))), rows(*BODY), end())
    with pytest.raises(TakeError, match=r"no channel 'remi'; there are remi.k1, remi.k2"):
        read(path, "remi")
    assert read(path, "k2").x.tolist() == read(path, "remi.k2").x.tolist() == [2e-3] * 4


def test_take_of_cut_recording_reports_damage(tmp_path: Path) -> None:
    complete = header(HANDS) + rows(*BODY[:3]) + rows(BODY[3]) + end()
    path = saved(tmp_path, complete[:-30])
    take = read(path, "ada")
    assert len(take.t) == 3
    assert take.damage == "54 bytes of this recording are damaged; what is left lasts 0.00 s"
    path.write_bytes(complete[:-17])
    assert "never finished" in str(read(path, "ada").damage)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a recording of hands"),
        (b"t [s],x [mm]\n0,0\n1,1\n", "not a recording of hands"),
        (header()[:8] + b"\x02\0\0\0" + header()[12:], "of version 2"),
        (header()[:-1], "header of this recording is damaged"),
        (header(rate=0.0), "header of this recording is damaged"),
        (header() + end(), "two samples or more"),
        (header() + rows(row(1, Axis(0.0)), row(2, Axis(float("nan")))), "sample 2 of x is not"),
        (header() + rows(row(1, Axis(0.0)), row(2, Axis(1e9))), "more than 1,000 m"),
        (header(rate=2e6, frames=1) + rows(row(1, Axis(0.0)), row(2, Axis(0.0))), "microsecond"),
    ],
)
def test_damaged_and_foreign_takes_are_refused(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(TakeError, match=words):
        read(saved(tmp_path, data))


def test_reading_folders_devices_and_missing_files_fails(tmp_path: Path) -> None:
    (tmp_path / "folder.take").mkdir()
    with pytest.raises(TakeError, match="the file does not exist"):
        read(tmp_path / "folder.take")
    with pytest.raises(OSError, match="regular"):
        _core.read_recording("/dev/zero")
    with pytest.raises(FileNotFoundError):
        _core.read_recording(tmp_path / "nowhere.take")


def test_recording_with_huge_chunk_length(tmp_path: Path) -> None:
    path = saved(tmp_path, header(), struct.pack("<IBI", 0xFFFFFFFF, ROWS, 0), bytes(100))
    result = _core.read_recording(path)
    assert len(result.ticks()) == 0
    assert result.lost_bytes == 109


SCORE = """
ergon: 1
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}, b: {BUT: {between: [k1, m], K: 9kN/m}}},
    out: {SOX: m}}
takes: {hand: {file: hand.FORM, channel: x}}
players: {ada: {key: k1}}
parts: {ada: [{at: 0.5s, play: hand}]}
"""


def test_recording_sounds_as_equal_csv(tmp_path: Path) -> None:
    ticks = np.arange(3000, 3400, dtype=np.uint64)
    x = 6e-3 * np.sin(np.arange(400) / 400 * np.pi) ** 2
    recording = _core.Recording(44100.0, 44, [("x", "k9")], "{}", ticks, x.reshape(-1, 1))
    (tmp_path / "hand.take").write_bytes(recording.to_bytes())
    t = (np.arange(400) * 44 / 44100).tolist()
    lines = [f"{t!r},{x!r}\n" for t, x in zip(t, x.tolist(), strict=True)]
    (tmp_path / "hand.csv").write_text("t [s],x [m]\n" + "".join(lines))
    listened = []
    for form in ("take", "csv"):
        (tmp_path / "s.yaml").write_text(SCORE.replace("FORM", form))
        loaded = load(tmp_path / "s.yaml")
        assert loaded.piece is not None
        staged = stage(loaded.piece)
        assert not staged.diagnostics
        out = np.zeros((44100, staged.simulation.n_out))
        staged.simulation.process(out)
        listened.append(out)
    assert np.abs(listened[0]).max() > 1e-6
    assert listened[0].tobytes() == listened[1].tobytes()


def test_recording_playback_equals_live_hand(tmp_path: Path) -> None:
    """What a real hand did, recorded from a tick on, plays as it did then."""
    score = SCORE.replace("FORM", "take").replace("{key: k1}", "{hand: live, key: k1}")
    score = score.replace("parts: {ada: [{at: 0.5s, play: hand}]}", "render: {tail: 1s}")
    loaded = load("s.yaml", text=score.replace("takes: {hand: {file: hand.take, channel: x}}", ""))
    assert loaded.piece is not None, loaded.diagnostics
    x = np.full(900, -2e-3)
    x[200:600] += 8e-3 * np.sin(np.arange(400) / 400 * np.pi) ** 2

    def rendered(positions: np.ndarray) -> np.ndarray:
        staged = stage(loaded.piece, real_hands={"ada": positions})
        (hand,) = staged.live_hands
        assert hand.tick_frames == 44
        out = np.zeros((40_000, staged.simulation.n_out))
        staged.simulation.process(out)
        return out

    data = [row(tick, Axis(x[tick])) for tick in range(150, 900) if tick not in (650, 651)]
    path = saved(tmp_path, header(), rows(*data), end())
    back = positions_from_start(_core.read_recording(path))
    assert back.shape == (900, 1)
    assert np.abs(rendered(x)).max() > 1e-6
    assert rendered(back[:, 0].copy()).tobytes() == rendered(x).tobytes()


@pytest.mark.parametrize(
    ("every", "words"),
    [
        ([], "the recording is empty"),
        ([1, 2**40], "too long"),
        ([2**40], "begins too late"),
    ],
)
def test_playback_refuses_empty_long_and_late_recordings(
    tmp_path: Path, every: list[int], words: str
) -> None:
    data = [row(tick, Axis(0.0)) for tick in every]
    path = saved(tmp_path, header(), rows(*data), end())
    with pytest.raises(NotRecordingError, match=words):
        positions_from_start(_core.read_recording(path))


def test_damaged_recording_in_score_is_warning(tmp_path: Path) -> None:
    every = [row(t, Axis(1e-3 * (t % 3))) for t in range(60)]
    data = header((("x", ""),)) + rows(*every[:50]) + rows(*every[50:])
    (tmp_path / "hand.take").write_bytes(data[:-5])
    (tmp_path / "s.yaml").write_text(SCORE.replace("FORM", "take"))
    loaded = load(tmp_path / "s.yaml")
    assert loaded.piece is not None
    (result,) = (d for d in stage(loaded.piece).diagnostics if d.code == "W314")
    assert (result.place.line, result.severity) == (7, "warning")
    assert "hand.take: 334 bytes of this recording are damaged" in result.message
