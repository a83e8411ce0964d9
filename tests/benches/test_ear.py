"""`python -m benches ear`: figures of sounds that are known, and verdicts on recordings."""

import math

import numpy as np
import pytest

from benches.ear import page
from benches.ear.features import FEATURES, NAMES
from benches.ear.partials import measure
from benches.ear.recorded import DATA, Recorded, distance
from benches.ear.verdict import Verdict
from docs.generators.cards import described

RATE = 44_100
T = np.arange(3 * RATE) / RATE


def tone(f: float, t60: float) -> np.ndarray:
    """A sine that falls by 60 dB in `t60` [s], after 10 ms of silence."""
    wave = np.sin(2 * np.pi * f * T) * 10 ** (-3 * T / t60)
    return np.concatenate([np.zeros(441), wave])


def figures(x: np.ndarray, rate: float = RATE) -> dict[str, float]:
    """The features of a sound in their units."""
    values = zip(NAMES, measure(x, rate), strict=True)
    return {name: FEATURES[name].plain(float(value)) for name, value in values}


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    return Recorded()


def test_measure_of_a_falling_sine() -> None:
    result = figures(tone(997.0, 2.5))
    assert result["t60_1000"] == pytest.approx(2.5, rel=0.02)
    assert result["t60_med"] == pytest.approx(2.5, rel=0.02)
    assert result["late"] == pytest.approx(-24.0, rel=0.02)
    assert result["slopes_p"] == pytest.approx(0.0, abs=0.05)
    assert result["fmax"] == pytest.approx(997.0, abs=1.0)
    assert result["n60"] == pytest.approx(2.0)  # 1 + the number of partials
    assert result["b_1000"] == pytest.approx(0.0, abs=0.01)
    assert result["b_4000"] < -40.0
    assert result["beat"] == 0.1


def test_measure_of_two_partials() -> None:
    result = figures(tone(500.0, 3.0) + 0.1 * tone(3000.0, 0.5))
    assert result["t60_500"] == pytest.approx(3.0, rel=0.03)
    assert result["t60_4000"] == pytest.approx(0.5, rel=0.1)
    assert result["n60"] == pytest.approx(3.0)
    assert result["top"] == pytest.approx(3000.0, abs=2.0)


def test_t60_slope_of_octave_partials() -> None:
    octaves = [tone(250.0 * 2**k, 4.0 / 2**k) for k in range(4)]
    result = figures(np.sum(octaves, axis=0))
    assert result["t60_slope"] == pytest.approx(-1.0, abs=0.05)
    assert result["t60_scatter"] == pytest.approx(0.0, abs=0.05)


def test_beat_measure_of_two_close_sines() -> None:
    """The level of two equal sines swings; that of one falls evenly."""
    pair = tone(1000.0, 4.0) + 0.5 * tone(1004.0, 4.0)
    assert figures(pair)["beat"] > 2.0
    assert figures(pair)["wobble"] > 2.0


def test_measure_of_noise() -> None:
    noise = np.random.default_rng(1).standard_normal(len(T)) * 10 ** (-3 * T / 1.0)
    result = figures(noise)
    assert result["b_flat"] > -4.0  # of exponentially distributed power: -2.5 dB
    assert result["hnr"] < 0.0
    assert result["b_cent"] == pytest.approx(10_000, rel=0.1)
    assert result["b_hi4"] == pytest.approx(10 * math.log10(16 / 20), abs=0.3)


def test_measure_of_an_attack() -> None:
    slow = np.sin(2 * np.pi * 440 * T) * np.clip(T / 0.1, 0, 1)
    assert figures(slow)["att"] == pytest.approx(0.08, abs=0.005)
    assert figures(tone(440.0, 3.0))["att"] < 0.005


def test_measure_of_another_rate() -> None:
    t = np.arange(3 * 48_000) / 48_000
    wave = np.sin(2 * np.pi * 700 * t) * 10 ** (-3 * t / 1.5)
    result = figures(np.concatenate([np.zeros(480), wave]), 48_000)
    assert result["fmax"] == pytest.approx(700.0, abs=1.0)
    assert result["t60_500"] == pytest.approx(1.5, rel=0.05)


def test_measure_of_silence() -> None:
    with pytest.raises(ValueError, match="silent"):
        measure(np.zeros(RATE), RATE)


def test_recordings_of_other_sources_are_classified(recorded: Recorded) -> None:
    ranks = [rank for each in recorded.ranks_without_source().values() for rank in each]
    assert len(ranks) > 400
    assert np.mean([rank == 1 for rank in ranks]) > 0.7
    assert np.mean([rank <= 3 for rank in ranks]) > 0.9


def test_distance_of_recordings_and_of_noise(recorded: Recorded) -> None:
    """95 % of pianos lie nearer to pianos than a burst of noise with their decay."""
    kin = recorded.kin("piano", 48)
    noise = np.random.default_rng(1).standard_normal(len(T)) * 10 ** (-3 * T / 6.0)
    inside = np.percentile(recorded.distances(kin), 95)
    assert inside < 1.3
    assert distance(kin.deviations(measure(noise, RATE))) > 2 * inside


def test_other_sources_of_class_with_several(recorded: Recorded) -> None:
    """Salamander's pianos lie farther from FluidR3's than 95 % of all pianos from their mean."""
    kin = recorded.kin("piano", 48)
    others = recorded.other_sources(kin)
    assert set(others) == {"FluidR3", "Salamander"}
    assert min(others.values()) > np.percentile(recorded.distances(kin), 95)


def test_other_sources_of_class_with_one(recorded: Recorded) -> None:
    assert recorded.other_sources(recorded.kin("marimba", 53)) == {}


def test_other_sources_with_few_recordings(recorded: Recorded) -> None:
    """Sonic Pi has two snares: too few to be compared, but of the others' recordings."""
    assert set(recorded.other_sources(recorded.kin("snare"))) == {"FluidR3", "AVL Drumkits"}


def test_ear_data_file_size_limit() -> None:
    assert DATA.stat().st_size < 300_000


def test_ear_classes_of_cards_in_recorded_data(recorded: Recorded) -> None:
    wanted = {
        name: card["ear"]["class"]
        for family in described().values()
        for name, card in family["cards"].items()
        if "ear" in card
    }
    assert len(wanted) >= 21
    assert set(wanted.values()) <= set(recorded.learnt.classes)
    assert set(page.before()) <= set(wanted)


def test_ear_page_row_of_each_verdict(recorded: Recorded) -> None:
    row = np.array([measure(tone(130.8, 5.0), RATE)] * 3)
    verdict = Verdict(
        "strings",
        "piano",
        "piano",
        "bell",
        4,
        2.5,
        1.0,
        0.01,
        (-40.0, -30.0, -20.0),
        row,
        ("x",),
        (2.6, 3.1),
    )
    text = page.text(recorded, [verdict], {"piano": 48.0})
    (first,) = [line for line in text.splitlines() if line.startswith("| `piano` | piano |")]
    old = page.before()["piano"]
    assert (
        f"| bell | 4 ({old['rank']}) | 2.50 ({float(old['distance']):.2f}) [1.00; 2.60–3.10] |"
        in first
    )
    assert "1 of the older 1 are within what one source is from the others: 1 of" in text
    assert "| `piano` | -40.0 / -30.0 / -20.0 | 20.0 |" in text
    assert "0 of 1 are taken for what they are" in text
