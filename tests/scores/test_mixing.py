"""Pans, fades, rooms and radiation of a mix, as scores write them."""

import numpy as np
import pytest
from checked import check, check_reports, codes
from scipy.signal import lfilter
from sessions import Stepped

from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import stage

RATE = 44100
SCORE = """\
ergon: 1
marks: {A: 1|1, B: 1|2}
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: A3, t60: 9s, V0: 0.2m/s}}}
    out: {SOA: m}
mix:
  channels: 2
  ROOMS
  route:
    - {from: bell, to: [1, 2], TREATED}
  MASTER
render: {tail: 2s}
"""
ROOMS = "rooms: {hall: {t60: {200Hz: 2s, 6kHz: 0.8s}, size: 8m}}"
PLAIN = "gain: 0dB"


def score(treated: str = PLAIN, rooms: str = "", master: str = "") -> str:
    text = SCORE.replace("TREATED", treated).replace("ROOMS", rooms)
    return text.replace("MASTER", master)


def mixed_score(text: str, n_frames: int = 30_000) -> np.ndarray:
    staged = stage(load("x.yaml", text=text).piece, planned=True)
    mixer = staged.mixer()
    frames = np.zeros((n_frames, staged.simulation.n_out))
    staged.simulation.process(frames)
    mixed = np.zeros((n_frames, staged.n_channels))
    mixer.process(frames, mixed)
    return mixed


def digest(text: str) -> str:
    return digest_of(check(text).piece)


@pytest.mark.parametrize(("pan", "gains"), [(-1, (1, 0)), (0, (0.5**0.5,) * 2), (0.28, (0.6, 0.8))])
def test_pan_gains_preserve_power(pan, gains):
    plain, panned = mixed_score(score()), mixed_score(score(f"pan: {pan}"))
    assert np.allclose(panned, plain * gains, rtol=1e-12, atol=0)


def test_fade_levels_at_positions():
    fade = "{at: A, gain: -40dB}, {at: B, gain: 0dB, curve: line}, {at: B+1/2, gain: -6dB}"
    fade = f"fade: [{fade}]"
    plain, faded = mixed_score(score(), 80_000), mixed_score(score(fade), 80_000)
    position = np.array([1000, 22_050, 44_100, 55_125, 70_000])
    gains = 20 * np.log10(faded[position, 0] / plain[position, 0])
    assert gains == pytest.approx([-40 + 40 * 1000 / 44_100, -20, 0, -3, -6], abs=1e-9)


def test_master_fade_to_zero():
    fade = "master: {fade: [{at: A, gain: 0dB}, {at: 0.5s, gain: x0}]}"
    plain, faded = mixed_score(score()), mixed_score(score(master=fade))
    assert faded[11_025, 1] == pytest.approx(plain[11_025, 1] / 2)
    assert not faded[22_050:].any()


def test_radiate_delay_and_level_by_distance():
    near, far = (
        mixed_score(score(f"radiate: {{distance: {d}, radius: 2cm}}")) for d in ("1m", "8m")
    )
    plain = mixed_score(score())
    # rho · S · a / (2 pi r), S = pi (2 cm)²
    gain, late = 1.204 * 0.02**2 / 2, [round(d / 343 * RATE) for d in (1, 8)]
    assert np.allclose(near[late[0] :], plain[: -late[0]] * gain, rtol=1e-12, atol=0)
    assert np.allclose(far[late[1] :], plain[: -late[1]] * gain / 8, rtol=1e-12, atol=0)
    assert not far[: late[1]].any()


def test_room_tail_and_sum_of_stems():
    treated = "send: {hall: -6dB}, pan: 0.3, highpass: 20Hz"
    text = score(treated, ROOMS).replace("t60: 9s", "t60: 50ms")
    other = "gong: {modules: {m: {CEL: {M: 2g, f: C4, t60: 1s, V0: 1m/s}}}, out: {SOA: m}}"
    other = f"  {other}\nmix:"
    route = "\n    - {from: gong, to: 1, send: {hall: 0dB}}"
    text = text.replace("mix:", other).replace("highpass: 20Hz}", "highpass: 20Hz}" + route)
    staged = stage(load("x.yaml", text=text).piece, planned=True)
    frames = np.zeros((44_100, staged.simulation.n_out))
    staged.simulation.process(frames)
    complete = np.zeros((44_100, 2))
    staged.mixer().process(frames, complete)
    stems = [np.zeros_like(complete) for _ in staged.stems()]
    for (_, mixer), stem in zip(staged.stems(), stems, strict=True):
        mixer.process(frames, stem)
    assert np.allclose(sum(stems), complete, rtol=0, atol=1e-9 * np.abs(complete).max())
    late = np.abs(stems[0][22_050:]).max() / np.abs(stems[0][:2205]).max()
    assert 1e-4 < late < 0.1, "the bell itself has faded by 600 dB there"


def test_notes_of_instrument_share_one_stem():
    bells = "bells: {notes: [C4, E4], modules: {m: {CEL: {M: 2g, f: C4, V0: 1m/s}}}, out: {SOA: m}}"
    text = score().replace("mix:", f"  {bells}\nmix:")
    text = text.replace("route:", "route:\n    - {from: bells, to: 1}")
    staged = stage(load("x.yaml", text=text).piece)
    frames = np.random.default_rng(1).standard_normal((100, staged.simulation.n_out))
    complete = np.zeros((100, 2))
    staged.mixer().process(frames, complete)
    named = dict(staged.stems())
    assert list(named) == ["bells", "bell"]
    stems = [np.zeros_like(complete) for _ in named]
    for mixer, stem in zip(named.values(), stems, strict=True):
        mixer.process(frames, stem)
    assert np.allclose(sum(stems), complete, rtol=0, atol=1e-9 * np.abs(complete).max())


def test_mix_live_equals_render(tmp_path):
    """A room, a fade and a radiation while lines are typed, and the journal: the same bytes."""
    treated = "send: {hall: -6dB}, pan: 0.3, radiate: {distance: 3m}, fade: {at: A, gain: -3dB}"
    fade = "master: {fade: [{at: B, gain: 0dB}, {at: B+2, gain: -20dB}]}"
    stepped = Stepped(score(treated, ROOMS, fade), tmp_path)
    stepped.run(0.5)
    stepped.ok("set bell.m.K x1.2 now")
    stepped.run(0.5)
    stepped.ok("gain bell -6dB")
    stepped.run(1.0)
    stepped.close()
    assert np.array_equal(stepped.again(), stepped.sound)
    # The version that took over went on with the room as it sounded.
    rings = np.abs(np.diff(stepped.sound[:, 0], 3))
    assert rings[22_000:26_000].max() < 2 * rings[10_000:22_000].max()


def test_digest_of_pan_room_and_master_values():
    assert digest(score()) != digest(score("pan: 0"))
    assert digest(score("pan: 0")) != digest(score("pan: 0.1"))
    assert digest(score(rooms=ROOMS)) != digest(score(rooms=ROOMS.replace("8m", "9m")))
    assert digest(score(master="master: {gain: 0dB}")) == (
        digest(score(master="master: {gain: x1}"))
    )


@pytest.mark.parametrize(
    ("treated", "rooms", "code", "words"),
    [
        ("pan: 1.5", "", "E202", "above the maximum of 1"),
        ("send: {hal: -6dB}", ROOMS, "E301", "no room is called 'hal'"),
        ("send: {hall: -6dB}", "", "E301", "no room is called 'hall'"),
        ("fade: {at: Q, gain: 0dB}", "", "E301", "no mark is called 'Q'"),
        ("fade: {at: A}", "", "E103", "gain"),
        ("radiate: {radius: 2cm}", "", "E103", "distance"),
        ("radiate: {distance: 1mm}", "", "E202", "distance"),
        (PLAIN, "rooms: {hall: {size: 8m}}", "E103", "t60"),
        (PLAIN, "rooms: {hall: {t60: {1Hz: 1s, 2Hz: 1s, 3Hz: 1s}}}", "E106", "two frequencies"),
        (PLAIN, "rooms: {hall: {t60: 2s, to: 3}}", "E202", "channel 3 does not exist"),
        (PLAIN, "rooms: {hall: {t60: 2s, to: 65}}", "E202", "the range from 1 to 64"),
    ],
)
def test_mix_mistakes_codes_and_lines(treated, rooms, code, words):
    reports = check_reports(score(treated, rooms))
    assert reports, "it is refused"
    assert any(c == code and words in message for c, _, message in reports), reports
    lines = {line for c, line, _ in reports if c == code}
    assert lines <= {9, 11}, reports


def test_room_with_impossible_t60_is_refused():
    text = score(rooms="rooms: {hall: {t60: {200Hz: 9s, 300Hz: 0.1s}}}")
    with pytest.raises(StageError) as refused:
        stage(load("x.yaml", text=text).piece)
    (report,) = refused.value.diagnostics
    assert (report.code, report.place.line) == ("E202", 9)
    assert "are impossible at these frequencies" in report.message


def test_pan_on_other_than_two_channels_is_refused():
    assert codes(score("pan: 0.5").replace("to: [1, 2]", "to: 1")) == ["E103"]


def test_radiate_of_position_output_is_refused():
    text = score("radiate: {distance: 1m}")
    assert codes(text) == []
    assert codes(text.replace("SOA: m", "SOX: m")) == ["E304"]


# --- pans that move -----------------------------------------------------------------------------


def turned(path: str, n_frames: int = 80_000) -> np.ndarray:
    """The gains of both channels, frame by frame."""
    plain = mixed_score(score(), n_frames)
    loud = np.abs(plain[:, :1]) > 1e-3 * np.abs(plain).max()
    return np.divide(
        mixed_score(score(path), n_frames), plain, out=np.full(plain.shape, np.nan), where=loud
    )


def test_pan_path_gains_by_angle():
    gains = turned("pan: [{at: A, pan: -1}, {at: B, pan: 1}]")
    frames = np.arange(80_000)
    angle = np.pi / 2 * np.minimum(frames / 44_100, 1.0)
    exact = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert np.nanmax(np.abs(gains - exact)) < 1e-12


def test_pan_path_between_intermediate_pans():
    """Its ends are those of `pan: -0.28` and `pan: 0.6`; halfway is the middle of the angles."""
    gains = turned("pan: [{at: A, pan: -0.28, curve: line}, {at: B, pan: 0.6, curve: smooth}]")
    ends = [np.arccos(0.28) / 2, np.arccos(-0.6) / 2]
    u = np.minimum(np.arange(80_000) / 44_100, 1.0)
    angle = ends[0] + (ends[1] - ends[0]) * (3.0 - 2.0 * u) * u * u
    exact = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert np.nanmax(np.abs(gains - exact)) < 1e-12


def test_pan_path_with_fade_and_room_send():
    fade = "fade: [{at: A, gain: -6dB}]"
    path = "pan: [{at: A, pan: -1}, {at: B, pan: 1}]"
    alone, faded = mixed_score(score(path)), mixed_score(score(f"{path}, {fade}"))
    assert np.allclose(faded, alone * 10 ** (-6 / 20), rtol=1e-12, atol=0)
    send = "send: {hall: 0dB}"
    room = [
        mixed_score(score(f"{send}, {pan}", ROOMS)) - mixed_score(score(pan))
        for pan in (path, "pan: 0")
    ]
    assert np.abs(room[0]).max() > 0.0
    assert np.allclose(room[0], room[1], rtol=0, atol=1e-9 * np.abs(room[0]).max())


@pytest.mark.parametrize(
    ("treated", "code", "words"),
    [
        ("pan: [{at: A, pan: 2}]", "E202", "above the maximum of 1"),
        ("pan: [{at: Q, pan: 0}]", "E301", "no mark is called 'Q'"),
        ("pan: [{at: A}]", "E103", "pan"),
        ("lowpass: 0Hz", "E202", "lowpass"),
        ("lowshelf: {f: 200Hz}", "E103", "gain"),
        ("lowshelf: {f: 200Hz, gain: x0}", "E202", "must be above x0"),
        ("highshelf: 3kHz", "E106", "highshelf"),
        ("delay: 11s", "E202", "above the maximum of 10 s"),
        ("delay: {time: 1s, feedback: 0dB}", "E202", "below 0dB"),
        ("delay: 250", "E203", "no unit"),
    ],
)
def test_route_treatment_mistakes_codes_and_lines(treated, code, words):
    reports = check_reports(score(treated))
    assert any(c == code and words in message for c, _, message in reports), reports
    assert {line for c, line, _ in reports if c == code} == {11}, reports


# --- filters and delays, beside scipy -----------------------------------------------------------


def cookbook(kind: str, f: float, level: float = 0.0) -> tuple[list[float], list[float]]:
    """Coefficients b and a of Bristow-Johnson's cookbook, with Q = 1/√2, which is slope 1."""
    a, w = 10 ** (level / 40), 2 * np.pi * f / RATE
    c, alpha = np.cos(w), np.sin(w) / np.sqrt(2)
    if kind == "lowpass":
        return [(1 - c) / 2, 1 - c, (1 - c) / 2], [1 + alpha, -2 * c, 1 - alpha]
    if kind == "highpass":
        return [(1 + c) / 2, -(1 + c), (1 + c) / 2], [1 + alpha, -2 * c, 1 - alpha]
    s = 1 if kind == "lowshelf" else -1
    r = 2 * np.sqrt(a) * alpha
    b = [
        a * ((a + 1) - s * (a - 1) * c + r),
        s * 2 * a * ((a - 1) - s * (a + 1) * c),
        a * ((a + 1) - s * (a - 1) * c - r),
    ]
    d = [
        (a + 1) + s * (a - 1) * c + r,
        -s * 2 * ((a - 1) + s * (a + 1) * c),
        (a + 1) + s * (a - 1) * c - r,
    ]
    return b, d


@pytest.mark.parametrize(
    ("written", "kind", "f", "level"),
    [
        ("lowpass: 300Hz", "lowpass", 300, 0),
        ("lowpass: 15kHz", "lowpass", 15_000, 0),
        ("highpass: 700Hz", "highpass", 700, 0),
        ("lowshelf: {f: 200Hz, gain: 9dB}", "lowshelf", 200, 9),
        ("lowshelf: {f: 400Hz, gain: -18dB}", "lowshelf", 400, -18),
        ("highshelf: {f: 3kHz, gain: -12dB}", "highshelf", 3000, -12),
        ("highshelf: {f: 150Hz, gain: 6dB}", "highshelf", 150, 6),
    ],
)
def test_route_filters_equal_cookbook_by_scipy(written, kind, f, level):
    plain, filtered = mixed_score(score()), mixed_score(score(written))
    expected = lfilter(*cookbook(kind, f, level), plain[:, 0])
    assert np.abs(filtered[:, 0] - expected).max() < 1e-10 * np.abs(plain).max()


def test_route_filters_in_succession():
    written = "highpass: 90Hz, lowpass: 2kHz, lowshelf: {f: 300Hz, gain: 4dB}"
    written += ", highshelf: {f: 1kHz, gain: -7dB}"
    expected = mixed_score(score())[:, 0]
    for item in (
        ("highpass", 90),
        ("lowpass", 2000),
        ("lowshelf", 300, 4),
        ("highshelf", 1000, -7),
    ):
        expected = lfilter(*cookbook(*item), expected)
    assert (
        np.abs(mixed_score(score(written))[:, 1] - expected).max() < 1e-10 * np.abs(expected).max()
    )


def test_route_delay_and_feedback_echoes():
    plain = mixed_score(score())[:, 0]
    frames = round(0.1 * RATE)
    later = mixed_score(score("delay: 100ms"))[:, 0]
    assert np.array_equal(later[frames:], plain[:-frames])
    assert not later[:frames].any()
    echoes = mixed_score(score("delay: {time: 100ms, feedback: -6dB}"))[:, 0]
    ratio = 10 ** (-6 / 20)
    line = np.zeros(frames + 1)
    expected = lfilter([*line[:-1], 1.0], [1.0, *line[1:-1], -ratio], plain)
    assert np.abs(echoes - expected).max() < 1e-12 * np.abs(plain).max()


def test_route_delay_feedback_with_radiate():
    radiate = "radiate: {distance: 3.43m}"  # 441 frames
    plain = mixed_score(score(radiate))[:, 0]
    echoes = mixed_score(score(f"{radiate}, delay: {{time: 50ms, feedback: x0.5}}"))[:, 0]
    line = np.zeros(2205)
    expected = lfilter([*line, 1.0], [1.0, *line[1:], -0.5], plain)
    assert np.abs(echoes - expected).max() < 1e-12 * np.abs(plain).max()


def test_filter_above_half_rate_is_refused():
    for written in ("lowpass: 30kHz", "highpass: 22050Hz"):
        with pytest.raises(StageError) as refused:
            stage(load("x.yaml", text=score(written)).piece)
        (report,) = refused.value.diagnostics
        assert (report.code, report.place.line) == ("E202", 11)
        assert "below half of the rate, 44100 Hz" in report.message


def test_route_treatments_change_the_digest():
    texts = ["lowpass: 2kHz", "lowpass: 3kHz", "delay: 1s", "delay: {time: 1s, feedback: -6dB}"]
    texts += ["pan: [{at: A, pan: 1}]", "pan: [{at: B, pan: 1}]", "pan: 1", PLAIN]
    assert len({digest(score(text)) for text in texts}) == len(texts)


def test_mix_keys_differ_by_treatment():
    texts = [PLAIN, "lowpass: 2kHz", "lowpass: 3kHz", "lowshelf: {f: 2kHz, gain: 3dB}"]
    texts += ["delay: 1s", "delay: {time: 1s, feedback: -6dB}", "pan: 1", "pan: [{at: A, pan: 1}]"]
    listening = [stage(load("x.yaml", text=score(text)).piece).listening for text in texts]
    assert len({own.mix_key(["the same tap"]) for own in listening}) == len(texts)
