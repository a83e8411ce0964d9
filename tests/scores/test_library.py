"""What ships: every score and instrument is without mistakes, sounds, and has its pitches."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from sweep import few

from ergon import _core
from ergon.cli.demo import bundled_scores, score_title
from ergon.notation.tables import value_kinds
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import Stage, stage

Frames = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
SCORES = ROOT / "scores" / "library"
INSTRUMENTS = ROOT / "instruments" / "library"
CHECKED = [*SCORES.glob("*.yaml"), *SCORES.glob("gestures/*.yaml"), *INSTRUMENTS.glob("*.yaml")]
SECONDS = {  # as stated: from the first event to the end of the tail
    "one-gesture": 29.6,
    "tempo": 39.7,
    "hand": 36.3,
    "rain": 86.0,
    "two-keys": 33.0,
    "patterns": 31.0,
    "duet": 66.6,
    "fader": 30.7,
    "strokes": 30.5,
    "change-ringing": 76.09,
    "interlocking": 86.49,
    "evening-raga": 103.79,
    "workshop": 74.07,
    "drum-machine": 16.85,
    "bow-and-breath": 37.0,
    "bloom": 14.38,
    "near-and-far": 79.45,
    "three-breaths": 77.27,
    "one-rope": 39.08,
    "poured-chain": 33.0,
    "ocean-drum": 42.0,
    "torn-cloth": 35.0,
    "bottleneck": 31.92,
    "night-piece": 178.15,
    "procession": 176.97,
    "feathers": 240.08,
    "feathers-small": 240.08,
}
HANDS = ("duet", "fader", "one-rope", "poured-chain", "ocean-drum", "torn-cloth", "bottleneck")
HANDS += ("feathers", "feathers-small")
LIVE = [SCORES / f"{name}.yaml" for name in HANDS]
# `make test` renders these, `make test-long` all.
SHORT = {"strokes", "bloom", "one-gesture"}
RENDERED_SECONDS = {  # how many seconds are rendered here; others wholly
    "duet": 0.5,
    "two-keys": 4.0,
    "rain": 6.0,
    "strokes": 2.0,
    "change-ringing": 2.0,
    "interlocking": 2.0,
    "evening-raga": 1.0,
    "workshop": 0.8,
    "drum-machine": 0.7,
    "bow-and-breath": 2.0,
    "bloom": 0.7,
    "near-and-far": 2.0,
    "three-breaths": 1.0,
    "one-rope": 1.0,
    "poured-chain": 1.0,
    "ocean-drum": 1.0,
    "torn-cloth": 1.0,
    "bottleneck": 1.0,
    "night-piece": 6.0,
    "procession": 1.0,
    "feathers": 0.5,
    "feathers-small": 1.0,
}
REFERENCE = 0.1  # full scale at which reference quantities are heard: -20 dB
CENTS = 5.0


def piece_of(path: Path, **texts: str) -> Piece:
    loaded = load(path, **texts)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def play(staged: Stage, seconds: float, reference: float | None = None) -> Frames:
    """Mixed frames (n_frames, n_channels), high-passed as in a file; without reference in SI."""
    n = min(int(seconds * staged.rate), staged.n_frames)
    frames = np.zeros((n, staged.simulation.n_out))
    staged.simulation.process(frames)
    mixed = np.zeros((n, staged.n_channels))
    staged.mixer(highpass=8.0, reference=reference).process(frames, mixed)
    return mixed


@cache
def staged_and_rendered(name: str) -> tuple[Stage, Frames]:
    staged = stage(piece_of(SCORES / f"{name}.yaml"))
    return staged, play(staged, RENDERED_SECONDS.get(name, 1e9), REFERENCE)


def write(text: str) -> Stage:
    """A small score of the test's own, with what ships."""
    loaded = load(SCORES / "here.yaml", text="ergon: 1\n" + text)
    assert loaded.piece is not None, loaded.diagnostics
    assert loaded.diagnostics == []
    return stage(loaded.piece)


def struck(file: str, hammer: str, scale: float = 1.0, out: str | None = None) -> Stage:
    """An instrument that ships, struck once at 0.1 s by a key."""
    name, _, _ = hammer.partition(".")
    return write(f"""
use: [instruments/{file}.yaml, gestures/common.yaml]
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}}}
instruments:
  action: {{modules: {{b: {{BUT: {{between: [k, {hammer}], K: 4kN/m, Z: 2Ns/m}}}}}}}}
players: {{ada: {{key: k}}}}
parts: {{ada: [{{at: 0.1s, play: tap, do: [scale {scale}]}}]}}
mix: {{route: {{from: {out or name}, to: 1}}}}
render: {{tail: 6s}}
""")


def spectrum(x: Frames, rate: float) -> tuple[Frames, Frames]:
    """Frequencies [Hz] and magnitudes; four times finer than the stretch allows."""
    magnitude = np.abs(np.fft.rfft(x * np.blackman(len(x)), 4 * len(x)))
    return np.fft.rfftfreq(4 * len(x), 1 / rate), magnitude


def pitch(x: Frames, rate: float, near: float, width: float = 0.03) -> float:
    """The strongest frequency within a few percent of one, between bins by a parabola."""
    f, s = spectrum(x, rate)
    inside = np.flatnonzero((f > near * (1 - width)) & (f < near * (1 + width)))
    top = int(inside[np.argmax(s[inside])])
    a, b, c = np.log(s[top - 1 : top + 2])
    return float(f[top] + 0.5 * (a - c) / (a - 2 * b + c) * (f[1] - f[0]))


def cents(f: float, other: float) -> float:
    return float(1200 * np.log2(f / other))


def level(x: Frames) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


# --- all of it ----------------------------------------------------------------------------------


# As feathers-small in all but the number of modules, of which test_feathers counts both.
LARGE = SCORES / "feathers.yaml"
SMALL = [path for path in CHECKED if path != LARGE]


@pytest.mark.parametrize(
    "path", few(CHECKED, SMALL), ids=lambda path: f"{path.parent.name}/{path.stem}"
)
def test_library_scores_check_without_error_or_warning(path: Path) -> None:
    loaded = load(path)
    assert loaded.piece is not None, loaded.diagnostics
    # The parts of some can be played by their modes alone, which a plan chooses.
    staged = stage(loaded.piece, planned=True, is_draft=True)
    # Only live hands have something to say: what stands in for them plays.
    codes = [found.code for found in (*loaded.diagnostics, *staged.diagnostics)]
    assert codes == (["N401"] if path in LIVE else [])


def test_library_instruments_have_outputs() -> None:
    for path in INSTRUMENTS.glob("*.yaml"):
        for instrument in piece_of(path).instruments.values():
            assert instrument.outputs, f"{path.name}: {instrument.name}"


def test_library_scores_have_title_length_and_comments() -> None:
    assert set(bundled_scores()) == set(SECONDS)
    for path in bundled_scores().values():
        assert score_title(path)
        text = path.read_text(encoding="utf-8")
        assert sum("# " in line for line in text.splitlines()) >= 6
        assert max(map(len, text.splitlines())) <= 120


@pytest.mark.parametrize("name", few(SECONDS, SHORT))
def test_library_scores_sound(name: str) -> None:
    staged, x = staged_and_rendered(name)
    assert staged.n_frames / staged.rate == pytest.approx(SECONDS[name], abs=0.05)
    assert np.all(np.isfinite(x))
    peak = np.max(np.abs(x))
    assert 1e-5 < peak < 1.0
    assert np.max(np.abs(np.mean(x, axis=0))) < 0.01 * peak
    if name not in RENDERED_SECONDS:
        # Nothing longer than a breath is silent (-60 dB) before the tail.
        end = int((staged.n_frames / staged.rate - staged.piece.render.tail) / 0.5)
        half = int(staged.rate / 2)
        levels = [np.max(np.abs(x[i * half : (i + 1) * half])) for i in range(end)]
        silent = "".join("." if one < 1e-3 * peak else "x" for one in levels)
        assert "......" not in silent
        # It ends in silence, not in the middle of a sound.
        assert level(x[-half:]) < 0.02 * max(
            level(x[i * half : (i + 1) * half]) for i in range(end)
        )


def loneliest(x: Frames, rate: float) -> float:
    """The treble of the frame that stands out most, over the most within 5 ms after it.

    A stroke, however bright, rings on; the treble of a click is over in three frames.
    """
    treble = np.max(np.abs(np.diff(x, n=3, axis=0)), axis=1)
    wide = int(0.005 * rate)
    after = sliding_window_view(np.pad(treble, (0, wide + 4)), wide)[4 : 4 + len(treble)]
    strong = np.flatnonzero(treble > 0.01 * np.max(np.abs(x)))
    return float(np.max(treble[strong] / np.max(after[strong], axis=1))) if len(strong) else 0.0


@pytest.mark.slow
def test_library_scores_have_no_clicks() -> None:
    """A click is a step: more treble in one sample than any sound around it has."""
    for name in ("one-gesture", "tempo", "hand"):
        staged, x = staged_and_rendered(name)
        assert loneliest(x, staged.rate) < 3.0
        clicked = x.copy()
        clicked[int(15.2 * staged.rate) :] += 0.02 * np.max(np.abs(x))
        assert loneliest(clicked, staged.rate) > 3.0


def test_times_counts_the_rounds_of_a_pattern() -> None:
    piece = piece_of(SCORES / "patterns.yaml")
    assert {own.name: len(own.place_beats(piece)) for own in piece.strikes} == {
        "tune": 8 * 5,  # rounds of eight steps, of which five strike
        "walk": 16,  # rounds of one step, before chance
        "three": 3 * 3,
    }
    played = zip(piece.parts, piece.starts, strict=True)
    assert [(play.played_text, len(starts or ())) for play, starts in played] == [
        ("tap ~ (soft soft) loose", 2 * 5),
        ("choose tap soft loose", 8),
        ("tap soft", 4 * 5),
        ("shuffle tap soft loose ~", 2 * 4),
    ]


def test_duet_score_channels_and_measured_key() -> None:
    staged = stage(piece_of(SCORES / "duet.yaml"))
    assert staged.n_channels == 24
    assert {way.channel for way in staged.listening.tap_routes if way.part == "sky"} == set(
        range(24)
    )
    assert {way.channel for way in staged.listening.tap_routes if way.part == "gong"} == set(
        range(24)
    )
    sky = next(m for m in staged.piece.instruments["sky"].modules if m.kind == "BANK")
    assert sky.fields["count"] == 10_000
    k2 = staged.piece.keys["k2"].modules[0].fields
    assert (k2["M"], k2["K"], k2["Z"]) == (0.395, 58.0, 1.1)  # as measured


@pytest.mark.slow
def test_coupled_keys_sound_on_other_instrument() -> None:
    """From C on only ada plays for eight beats, and remi's sheet of steel sounds with hers."""
    text = (SCORES / "two-keys.yaml").read_text(encoding="utf-8")
    alone = text[: text.index("parts:")] + "parts: {ada: [{at: C, play: hit, every: 1, times: 2}]}"
    alone = alone.replace("- {at: 8|1, bpm: 84 -> 56, over: 2bar}", "").replace("C: 5|1", "C: 1|2")
    alone = alone.replace("  remi: {key: k2}\n", "")
    mix = "\nmix: {route: {from: sheet.right, to: 1}}"
    coupled = play(stage(piece_of(SCORES / "x.yaml", text=alone + mix)), 2.0)
    apart = alone.replace("REF: {K: 1.5kN/m, Z: 4Ns/m}", "REF: {K: 0N/m}")
    silent = play(stage(piece_of(SCORES / "x.yaml", text=apart + mix)), 2.0)
    assert np.max(np.abs(coupled)) > 1e-4  # m/s
    assert np.max(np.abs(silent)) == 0.0


# --- pitches ------------------------------------------------------------------------------------


def test_bell_has_its_partials() -> None:
    staged = struck("bell", "bell.hammer")
    x = play(staged, 3.0)[int(0.3 * staged.rate) :, 0]
    notes = {"prime": 440.0, "tierce": 523.2511, "quint": 659.2551, "nominal": 880.0}
    for name, f in notes.items():
        assert abs(cents(pitch(x, staged.rate, f, 0.02), f)) < CENTS, name
    f, s = spectrum(x, staged.rate)
    audible_partials = [
        20 * np.log10(s[np.abs(f - at).argmin()] / s.max()) for at in notes.values()
    ]
    assert min(audible_partials) > -40.0


def test_bell_harder_strokes_are_louder_and_brighter() -> None:
    centroids, levels = [], []
    for scale in (0.7, 0.85, 1.05):
        staged = struck("bell", "bell.hammer", scale)
        x = play(staged, 0.6)[:, 0]
        f, s = spectrum(x, staged.rate)
        centroids.append(float(np.sum(f * s**2) / np.sum(s**2)))
        levels.append(level(x))
    assert levels == sorted(levels)
    assert levels[2] > 2 * levels[0]
    assert centroids == sorted(centroids)


def test_string_sounds_d3_and_its_octave() -> None:
    staged = struck("string", "string.hammer")
    x = play(staged, 3.0)[int(0.3 * staged.rate) :, 0]
    f = pitch(x, staged.rate, 146.8324)
    assert abs(cents(f, 146.8324)) < CENTS
    second = pitch(x, staged.rate, 2 * f)
    assert abs(cents(second, 2 * f)) < CENTS


def test_bowed_string_sings_for_as_long_as_the_bow_moves() -> None:
    staged = write("""
use: [instruments/bowed.yaml]
mix: {route: {from: drone, to: 1}}
render: {tail: 6s}
""")
    x = play(staged, 6.0)[:, 0]
    half = len(x) // 2
    assert level(x[-half // 2 :]) == pytest.approx(level(x[half : half + half // 2]), rel=0.2)
    # A little flat: the hair drags on the string (McIntyre and Woodhouse).
    f = pitch(x[half:], staged.rate, 97.9989, 0.06)
    assert -60.0 < cents(f, 97.9989) < 5.0
    harmonics, s = spectrum(x[half:], staged.rate)
    strength = [s[np.abs(harmonics - k * f) < 3.0].max() for k in range(1, 7)]
    assert min(strength) > 0.02 * max(strength)


def test_tamtam_shimmers_and_falls_in_pitch() -> None:
    loud = struck("gong", "tamtam.mallet", 1.05, "tamtam.left")
    soft = struck("gong", "tamtam.mallet", 0.65, "tamtam.left")
    high = []
    for staged in (loud, soft):
        x = play(staged, 1.2)[:, 0]
        f, s = spectrum(x[int(0.3 * staged.rate) :], staged.rate)
        high.append(float(np.sum(s[f > 900] ** 2) / np.sum(s**2)))
    assert high[0] > 2 * high[1]
    x = play(loud, 4.8)[:, 0]
    early = pitch(x[: int(0.5 * loud.rate)], loud.rate, 95.0, 0.15)
    late = pitch(x[int(3.5 * loud.rate) :], loud.rate, 92.0, 0.15)
    assert cents(early, late) > 10.0


def test_banks_members_have_their_pitches() -> None:
    members = {0: "A2", 12: "A3", 15: "C4", 60: "A7"}
    strikes = "\n".join(
        f"  s{i}: {{to: scale.{i}, at: {0.1 + 0.01 * i}s, impulse: 1mNs}}" for i in members
    )
    staged = write(
        "use: [instruments/bank.yaml]\nmix: {route: {from: scale, to: [1, 2]}}\n"
        f"strikes:\n{strikes}\n"
    )
    x = play(staged, 3.0)[int(0.8 * staged.rate) :].sum(axis=1)
    for note in members.values():
        f = value_kinds.PITCH.parse(note)
        assert abs(cents(pitch(x, staged.rate, f, 0.02), f)) < 1.0, note


# --- laws ---------------------------------------------------------------------------------------


def law(name: str, **constants: float) -> _core.Law:
    written: dict[str, Any] = yaml.load(
        (INSTRUMENTS / "laws.yaml").read_text(encoding="utf-8"), yaml.BaseLoader
    )["laws"][name]
    words = {key: written.pop(key, None) for key in ("doc", "law", "damping")}
    assert words["doc"]
    values = {key: value_kinds.CONSTANT.parse(text) for key, text in written.items()}
    assert constants.keys() <= values.keys()
    return _core.Law(words["law"], words["damping"], {**values, **constants})


def test_library_force_laws_by_formula() -> None:
    d = [-4e-3, -1e-3, -1e-4, 1e-4, 1e-3, 4e-3]
    cubic = law("cubic", k=100.0, q=1e8)
    assert [cubic.force(x) for x in d] == pytest.approx([100 * x + 1e8 * x**3 for x in d])
    clipped = law("clipped-cubic", k=100.0, q=1e8, F=2.0)
    assert [clipped.force(x) for x in d] == pytest.approx(
        [min(2.0, max(-2.0, cubic.force(x))) for x in d]
    )
    power = law("power", c=1e5, p=1.5)
    assert power.force(4e-4) == pytest.approx(1e5 * 4e-4**1.5)
    assert power.force(-4e-4) == -power.force(4e-4)
    rope = law("rope", k=500.0, z=2.0)
    assert (rope.force(-1e-3, 5.0), rope.force(1e-3)) == (0.0, 0.5)
    assert rope.force(1e-3, 0.1) == pytest.approx(0.7)


def test_detent_holds_and_pluck_lets_slip() -> None:
    x = np.linspace(-8e-3, 8e-3, 1601)
    for name, sign in (("detent", 1.0), ("pluck", -1.0)):
        built = law(name, F=2.0, w=1e-3)
        force = np.array([built.force(float(one)) for one in x])
        assert x[np.argmax(sign * force)] == pytest.approx(1e-3)
        assert np.max(force) == pytest.approx(2.0)
        assert abs(force[-1]) < 1e-9


def test_library_friction_laws_by_formula() -> None:
    bow = law("bow", F=0.8, a=50.0)
    v = np.linspace(-2, 2, 4001)
    force = np.array([bow.force(0.0, float(one)) for one in v])
    assert v[np.argmax(force)] == pytest.approx(0.1)
    assert np.max(force) == pytest.approx(0.8)
    assert np.all(force * v >= 0)
    assert law("bow", u=0.2).is_active(1e-3, 1.0)
    assert not bow.is_active(1e-3, 1.0)
    two = law("bow-hyperbolic", F=0.8, r=0.25, v1=0.05)
    assert two.force(0.0, 0.05 - 1e-12) == pytest.approx(0.8)
    assert two.force(0.0, 0.05 + 1e-12) == pytest.approx(0.8)
    assert two.force(0.0, -100.0) == pytest.approx(-0.8 * 0.25, rel=0.01)
    assert law("coulomb", F=0.3, s=0.01).force(0.0, 0.1) == pytest.approx(0.3)
