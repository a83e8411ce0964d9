"""What is a stroke and what is not, and several strokes of one object."""

import numpy as np
import pytest
from struck import RATE, church, matched

from ergon.workshop.bells import contact
from ergon.workshop.bells.bell import bell_from_strokes
from ergon.workshop.bells.stroke import NotAStrokeError, stroke

T = np.arange(int(3 * RATE)) / RATE


def rng():
    return np.random.default_rng(5)


def two_strokes():
    sound = church().sound(3.0)
    sound[int(1.2 * RATE) :] += 0.7 * church().sound(1.8)
    return sound


def clipped():
    sound = church().sound(3.0)
    return np.clip(sound, -0.3 * np.abs(sound).max(), 0.3 * np.abs(sound).max())


def speech():
    """Syllables: pulses of a gliding pitch through two formants."""
    pitch = 120 + 30 * np.sin(2 * np.pi * 1.3 * T)
    phase = 2 * np.pi * np.cumsum(pitch) / RATE
    voice = sum(np.cos(n * phase) / n for n in range(1, 30))
    gate = np.clip(np.sin(2 * np.pi * 3.1 * T), 0, 1) ** 2
    return gate * voice * np.linspace(1, 0.3, T.size)


SOUNDS = {
    "silence": (lambda: np.zeros(T.size), "silent"),
    "noise": (lambda: rng().standard_normal(T.size), "does not die away"),
    "fading noise": (lambda: rng().standard_normal(T.size) * np.exp(-2 * T), "explain"),
    "a sine": (lambda: np.sin(2 * np.pi * 440 * T), "die away|clipped"),
    "speech": (speech, "explain|strikes again"),
    "clipped": (clipped, "clipped"),
    "two strokes": (two_strokes, "strikes again 1\\.[12]"),
    "too short": (lambda: church().sound(0.05), "only 50 ms"),
}


@pytest.mark.parametrize("name", SOUNDS)
def test_stroke_refuses_other_sounds(name):
    make, reason = SOUNDS[name]
    with pytest.raises(NotAStrokeError, match=reason):
        bell_from_strokes([("point", stroke(f"{name}.wav", make(), RATE))])


def test_stroke_onset_detection_in_quiet_noise():
    sound = np.concatenate([1e-5 * rng().standard_normal(20000), church().sound(3.0)])
    assert stroke("a.wav", sound, RATE).sound.size == pytest.approx(3.0 * RATE, abs=0.035 * RATE)


def pushed(levels, length, impulse, seed):
    """A bell of levels, pushed by half a sine."""
    struck = church()
    listened = contact.spectrum(struck.f, length) * levels * impulse
    t = np.arange(int(4 * RATE)) / RATE
    modes = zip(struck.f, struck.d, listened, strict=True)
    sound = sum(a * np.exp(-d * t) * np.cos(2 * np.pi * f * t) for f, d, a in modes)
    sound = np.concatenate([np.zeros(int(length * RATE)), sound])
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(sound.size)
    return stroke(f"{seed}.wav", sound + noise, RATE)


@pytest.mark.slow
def test_strokes_of_two_places_levels_and_contact():
    levels = np.random.default_rng(2).uniform(0.2, 1.0, (2, church().f.size))
    strokes = [
        ("rim", pushed(levels[0], 0.4e-3, 1.0, 1)),
        ("rim", pushed(levels[0], 0.7e-3, 0.3, 2)),
        ("waist", pushed(levels[1], 0.4e-3, 1.0, 3)),
        ("waist", pushed(levels[1], 0.6e-3, 0.5, 4)),
    ]
    result = bell_from_strokes(strokes)
    struck = church()
    assert result.places == ("rim", "waist")
    pairs = matched(result.f, struck.f, cents=1.0)
    assert len(pairs) == len(struck.f)
    assert len(result.f) <= len(struck.f) + 2
    true, item = (np.array(column) for column in zip(*pairs, strict=True))
    low = struck.f[true] * 0.7e-3 < 1.0  # higher ones are lost in the soft stroke's notch
    for column in (0, 1):
        listened = np.abs(result.levels[item, column]) * result.listening_levels[item]
        ratio = np.log(listened / levels[column][true])[low]
        assert np.median(np.abs(ratio - np.median(ratio))) < 0.05
    assert result.strokes[1].impulse == pytest.approx(0.3, rel=0.15)
    assert result.contact == pytest.approx(0.4e-3, rel=0.3)


def hertz(f: np.ndarray, length: float) -> np.ndarray:
    """What a push leaves of modes that is narrower than half a sine, as of two round bodies."""
    t = np.linspace(0.0, length, 801)
    push = np.sin(np.pi * t / length) ** 1.5
    return np.abs(push @ np.exp(-2j * np.pi * f * t[:, None])) / push.sum()


@pytest.mark.parametrize("push", [contact.spectrum, hertz])
@pytest.mark.parametrize(("hard", "soft"), [(0.4e-3, 0.7e-3), (1e-3, 1.5e-3), (1e-3, 2e-3)])
def test_contact_lengths_from_hard_and_soft_strokes(push, hard: float, soft: float):
    f = church().f
    for seed in range(3):
        rng = np.random.default_rng(seed)
        levels = rng.uniform(0.2, 1.0, f.size)
        listened = np.stack([levels * push(f, hard), 0.4 * levels * push(f, soft)])
        listened *= np.exp(0.02 * rng.standard_normal(listened.shape))
        output = contact.fit_levels(f, listened, np.full(listened.shape, 0.02))
        lengths = [length or 0.0 for length in output.lengths]
        assert lengths == pytest.approx([hard, soft], rel=0.36)
        assert output.impulses == pytest.approx([1.0, 0.4], rel=0.1)
        low = np.log(output.levels / levels)[f * soft < 1.0]
        assert np.median(np.abs(low - np.median(low))) < 0.08


@pytest.mark.parametrize(("hard", "soft"), [(0.5e-3, 0.5e-3), (0.1e-3, 0.3e-3), (2e-3, 4e-3)])
def test_contact_lengths_absent_for_unsuitable_strokes(hard: float, soft: float):
    """Alike; so hard that no mode misses it; so soft that hardly a mode is within reach."""
    f = church().f
    for seed in range(3):
        rng = np.random.default_rng(seed)
        levels = rng.uniform(0.2, 1.0, f.size)
        listened = np.stack([levels * contact.spectrum(f, one) for one in (hard, soft)])
        listened *= np.exp(0.02 * rng.standard_normal(listened.shape)) * [[1.0], [0.4]]
        output = contact.fit_levels(f, listened, np.full(listened.shape, 0.02))
        assert output.lengths == (None, None)
        if hard < 1e-3:
            assert output.impulses == pytest.approx([1.0, 0.4], rel=0.05)


def test_stroke_onset_delay_of_soft_attack():
    """A soft stroke is loudest late; a mode of 10 ms would fall by 180 dB since it began."""
    t = np.arange(RATE) / RATE
    sound = np.cos(2 * np.pi * 440 * t) * np.exp(-3 * t) * np.minimum(t / 0.025, 1.0)
    first = stroke("soft.wav", sound, RATE)
    assert first.sound.size < RATE - 0.02 * RATE
    assert first.delay <= 0.004


def test_contact_stiffness_gives_contact_length():
    """A mass on Hertz's spring, stepped."""
    k, x, v, h, t = contact.stiffness(1e-3), 0.0, contact.HAMMER_SPEED, 1e-7, 0.0
    while x >= 0.0:
        v -= h * k * max(x, 0.0) ** 1.5 / contact.HAMMER_MASS
        x += h * v
        t += h
    assert t == pytest.approx(1e-3, rel=1e-3)
