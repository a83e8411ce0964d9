"""Pans, fades, rooms and radiation of a mix, as scores write them."""

import numpy as np
import pytest
from checked import check, codes, found
from sessions import Stepped

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


def heard(text: str, n_frames: int = 30_000) -> np.ndarray:
    staged = stage(load("x.yaml", text=text).piece, planned=True)
    mixer = staged.mixer()
    frames = np.zeros((n_frames, staged.simulation.n_out))
    staged.simulation.process(frames)
    mixed = np.zeros((n_frames, staged.n_channels))
    mixer.process(frames, mixed)
    return mixed


def digest(text: str) -> str:
    return check(text).piece.digest()


@pytest.mark.parametrize(("pan", "gains"), [(-1, (1, 0)), (0, (0.5**0.5,) * 2), (0.28, (0.6, 0.8))])
def test_a_pan_keeps_the_power(pan, gains):
    plain, panned = heard(score()), heard(score(f"pan: {pan}"))
    assert np.allclose(panned, plain * gains, rtol=1e-12, atol=0)


def test_a_fade_goes_by_positions():
    fade = "{at: A, gain: -40dB}, {at: B, gain: 0dB, curve: line}, {at: B+1/2, gain: -6dB}"
    fade = f"fade: [{fade}]"
    plain, faded = heard(score(), 80_000), heard(score(fade), 80_000)
    at = np.array([1000, 22_050, 44_100, 55_125, 70_000])
    gains = 20 * np.log10(faded[at, 0] / plain[at, 0])
    assert gains == pytest.approx([-40 + 40 * 1000 / 44_100, -20, 0, -3, -6], abs=1e-9)


def test_the_master_fades_to_nothing():
    fade = "master: {fade: [{at: A, gain: 0dB}, {at: 0.5s, gain: x0}]}"
    plain, faded = heard(score()), heard(score(master=fade))
    assert faded[11_025, 1] == pytest.approx(plain[11_025, 1] / 2)
    assert not faded[22_050:].any()


def test_a_disc_is_heard_later_and_softer_from_afar():
    near, far = (heard(score(f"radiate: {{distance: {d}, radius: 2cm}}")) for d in ("1m", "8m"))
    plain = heard(score())
    # rho · S · a / (2 pi r), S = pi (2 cm)²
    gain, late = 1.204 * 0.02**2 / 2, [round(d / 343 * RATE) for d in (1, 8)]
    assert np.allclose(near[late[0] :], plain[: -late[0]] * gain, rtol=1e-12, atol=0)
    assert np.allclose(far[late[1] :], plain[: -late[1]] * gain / 8, rtol=1e-12, atol=0)
    assert not far[: late[1]].any()


def test_a_room_goes_on_and_stems_add_up():
    treated = "send: {hall: -6dB}, pan: 0.3, highpass: 20Hz"
    text = score(treated, ROOMS).replace("t60: 9s", "t60: 50ms")
    other = "gong: {modules: {m: {CEL: {M: 2g, f: C4, t60: 1s, V0: 1m/s}}}, out: {SOA: m}}"
    other = f"  {other}\nmix:"
    route = "\n    - {from: gong, to: 1, send: {hall: 0dB}}"
    text = text.replace("mix:", other).replace("highpass: 20Hz}", "highpass: 20Hz}" + route)
    staged = stage(load("x.yaml", text=text).piece, planned=True)
    frames = np.zeros((44_100, staged.simulation.n_out))
    staged.simulation.process(frames)
    whole = np.zeros((44_100, 2))
    staged.mixer().process(frames, whole)
    stems = [np.zeros_like(whole) for _ in staged.stems()]
    for (_, mixer), stem in zip(staged.stems(), stems, strict=True):
        mixer.process(frames, stem)
    assert np.allclose(sum(stems), whole, rtol=0, atol=1e-9 * np.abs(whole).max())
    late = np.abs(stems[0][22_050:]).max() / np.abs(stems[0][:2205]).max()
    assert 1e-4 < late < 0.1, "the bell itself has faded by 600 dB there"


def test_the_notes_of_an_instrument_are_one_stem():
    bells = "bells: {notes: [C4, E4], modules: {m: {CEL: {M: 2g, f: C4, V0: 1m/s}}}, out: {SOA: m}}"
    text = score().replace("mix:", f"  {bells}\nmix:")
    text = text.replace("route:", "route:\n    - {from: bells, to: 1}")
    staged = stage(load("x.yaml", text=text).piece)
    frames = np.random.default_rng(1).standard_normal((100, staged.simulation.n_out))
    whole = np.zeros((100, 2))
    staged.mixer().process(frames, whole)
    named = dict(staged.stems())
    assert list(named) == ["bells", "bell"]
    stems = [np.zeros_like(whole) for _ in named]
    for mixer, stem in zip(named.values(), stems, strict=True):
        mixer.process(frames, stem)
    assert np.allclose(sum(stems), whole, rtol=0, atol=1e-9 * np.abs(whole).max())


def test_live_is_offline(tmp_path):
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


def test_what_says_nothing_new_has_the_old_hash():
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
    ],
)
def test_mistakes_have_places(treated, rooms, code, words):
    reports = found(score(treated, rooms))
    assert reports, "it is refused"
    assert any(c == code and words in message for c, _, message in reports), reports
    lines = {line for c, line, _ in reports if c == code}
    assert lines <= {9, 11}, reports


def test_a_room_that_cannot_fade_so_is_refused_in_its_place():
    text = score(rooms="rooms: {hall: {t60: {200Hz: 9s, 300Hz: 0.1s}}}")
    with pytest.raises(StageError) as refused:
        stage(load("x.yaml", text=text).piece)
    (report,) = refused.value.diagnostics
    assert (report.code, report.place.line) == ("E202", 9)
    assert "are impossible at these frequencies" in report.message


def test_only_two_channels_have_a_between():
    assert codes(score("pan: 0.5").replace("to: [1, 2]", "to: 1")) == ["E103"]


def test_a_position_does_not_radiate():
    text = score("radiate: {distance: 1m}")
    assert codes(text) == []
    assert codes(text.replace("SOA: m", "SOX: m")) == ["E304"]
