"""A session cannot shake a hand: each version is held against what the key bears."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from stiffenings import HANDS, Rig, Scene, measured, rig
from sweep import few

from ergon.live.automated import tangible_modules
from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import stage

# A motor gives a hand no more in the long run [W].
POWER_MAX = 0.05
STIFF = "set bell.b.K 5kN/m now"


def settled(rig: Rig, line: str) -> float:
    """Power after half a second of what a line has made [W], the key being hit."""
    rig.ok(line)
    rig.run(0.5)
    rig.kick()
    since = rig.board.periods
    rig.run(1.0)
    return rig.power(since)


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize(
    "line",
    few([STIFF, "set bell.b.K 5kN/m over 2bar now", "couple k1 k2 K=5kN/m Z=3Ns/m now"], 1),
)
def test_stiffer_coupling_scales_force_of_hand(tmp_path: Path, hand: str, line: str):
    with rig(tmp_path, hand, Scene().text) as single:
        assert single.scale == 1.0
        assert settled(single, line) <= POWER_MAX
        assert 0.02 <= single.scale < 0.9
        assert single.trips == 0


def test_force_scale_messages_and_recovery_by_undo(tmp_path: Path):
    with rig(tmp_path, "firm", Scene().text) as single:
        single.run(0.1)
        text = single.ok(STIFF).text
        assert "remi gets " in text
        assert "N/m stiff at this key" in text
        single.run(0.4)
        low = single.scale
        assert low < 0.9
        assert "feels" not in single.ok("ada plays knock now").text
        single.run(0.2)
        assert "feels" not in single.ok("undo").text  # the knock
        single.run(0.2)
        assert single.scale == low
        assert "remi gets the full force of the piece again" in single.ok("undo").text
        single.run(0.5)
        assert single.scale == 1.0


def test_force_scale_after_undo_reload_and_load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    soft, stiff = Scene(), Scene(stiffness=5e3)
    with rig(tmp_path, "firm", soft.text) as single:
        assert settled(single, STIFF) <= POWER_MAX
        low = single.scale
        single.ok("undo")
        single.run(0.5)
        assert single.scale == 1.0
        single.path.write_text(stiff.text, encoding="utf-8")
        assert settled(single, "reload") <= POWER_MAX
        assert single.scale == pytest.approx(low, rel=1e-3)
        single.path.with_name("soft.yaml").write_text(soft.text, encoding="utf-8")
        single.ok("load soft.yaml")
        single.run(0.5)
        assert single.scale == 1.0
        single.path.with_name("stiff.yaml").write_text(stiff.text, encoding="utf-8")
        assert settled(single, "load stiff.yaml") <= POWER_MAX
        assert single.scale == pytest.approx(low, rel=1e-3)
        assert single.trips == 0


def test_unbearable_coupling_is_refused_while_playing(tmp_path: Path):
    with rig(tmp_path, "none", Scene().text) as single:
        single.ok("play")
        single.ok("ada plays knock every 1/2 now")
        single.run(0.3)
        reply = single.session.submit("couple k1 k2 K=800kN/m Z=0Ns/m now")
        assert not reply.taken
        assert reply.text.startswith("with this line the piece would be ")
        assert "\n" not in reply.text
        single.run(1.0)
        assert single.scale == 1.0
        assert ("ada", "knock") in single.session.state().playing
        assert not single.session.schedule.head.piece.duet
        single.kick()
        since = single.board.periods
        single.run(0.5)
        assert single.power(since) <= POWER_MAX


def test_force_scale_timing_across_stiffer_version(tmp_path: Path):
    with rig(tmp_path, "firm", Scene().text) as single:
        single.ok(STIFF)
        position = single.session.schedule.running.start_frame
        last = single.session.schedule.running.force_bounds[0].last_scale.scale
        seen = _ticks(single, position + 40 * 44)
        # The tick whose first frame is that of the change is the first to end behind it.
        assert next(scale for frame, scale in seen if frame > position) == pytest.approx(
            last, abs=1e-9
        )
        assert np.abs(np.diff([1.0, *(scale for _, scale in seen)])).max() < 0.1  # no step
        # Softer over a second: nothing is given back before the glide says so.
        single.ok("set bell.b.K 300N/m over 1bar now")
        running = single.session.schedule.running
        (bearing,) = running.force_bounds
        assert bearing.last_scale.scale == 1.0
        bounds = [(running.start_frame + 44 * ticks, scale) for ticks, scale in bearing.bounds]
        for frame, scale in _ticks(single, bounds[-1][0] + 300 * 44):
            allowed = [bound for begins, bound in bounds if begins < frame]
            assert scale <= (allowed[-1] if allowed else last) + 1e-9
        assert single.scale == 1.0


def _ticks(rig: Rig, until: int) -> list[tuple[int, float]]:
    """Frame and scale after every period up to a frame."""
    seen = [(0, 1.0)]
    while seen[-1][0] < until:
        rig.run(0.001)
        status = rig.engine.performance.status()
        seen.append((status.frame, status.hands[0].scale))
    return seen[1:]


def test_force_bounds_unchanged_by_unrelated_lines(tmp_path: Path):
    """Counted: how often a scene is played against the key."""
    with rig(tmp_path, "firm", Scene().text) as single:
        bounds = single.engine.bounds_finder
        lines = "ada plays knock every 1 now", "tempo 200 now", "gain bell -6dB now", "undo"
        before = bounds.n_responses
        for line in lines:
            single.ok(line)
            single.run(0.1)
        assert bounds.n_responses == before
        single.ok(STIFF)
        assert bounds.n_responses == before + 1  # where it glides to: what it glides from is known


@pytest.mark.slow
@pytest.mark.parametrize("seed", few(range(6), (1, 3)))
def test_force_scale_under_random_stiffenings(tmp_path: Path, seed: int):
    for hand in HANDS:
        folder = tmp_path / hand
        folder.mkdir()
        power, trips, _, text = measured(folder, hand, seed)
        assert power <= POWER_MAX, text
        assert trips == 0, text


@pytest.mark.slow
def test_force_scale_under_two_hundred_random_stiffenings(tmp_path: Path):
    worst = 0.0
    for seed, hand in itertools.product(range(200), HANDS):
        folder = tmp_path / f"{seed}-{hand}"
        folder.mkdir()
        power, trips, _, text = measured(folder, hand, seed)
        assert power <= POWER_MAX, (seed, hand, text)
        assert trips == 0, (seed, hand, text)
        worst = max(worst, power)
    print(f"200 stiffenings x {len(HANDS)} hands: {worst:.3f} W at most, no trip")


SOFT_GROUND = Scene(stiffness=3e3, ground=100.0, mass=0.002)


@pytest.mark.parametrize("hand", few(HANDS, list(HANDS)[:1]))
@pytest.mark.parametrize(
    "line",
    few(
        [
            "set bell.m.K 100N/m 6kN/m every 1 now",
            "lfo bell.m.K 1..30 period 2bar now",
            "bell notes A3 C4 every 1 impulse 0.01mNs now",
        ],
        1,
    ),
)
def test_force_scale_under_stiffening_automation(tmp_path: Path, hand: str, line: str):
    with rig(tmp_path, hand, SOFT_GROUND.text) as single:
        assert single.scale == 1.0
        single.ok("play")
        single.run(0.2)
        settled(
            single, line
        )  # a spring that stiffens under a hand that is away does some work at first
        since = single.board.periods
        single.run(2.0)
        assert single.power(since) <= POWER_MAX
        assert 0.02 <= single.scale < 0.9
        assert single.trips == 0


@pytest.mark.parametrize("target", ["bell.m.K", "k1.K"])
def test_tangible_modules_of_automation_in_duet(tmp_path: Path, target: str):
    path = tmp_path / "score.yaml"
    automation = f"automation: [{{lfo: {target}, range: 1..30, period: 2bar, at: 1|1}}]\n"
    path.write_text(SOFT_GROUND.text + automation, encoding="utf-8")
    staged = stage(piece_of(Texts.read(path)), real_hands={"remi": None})
    result = tangible_modules(staged, ["remi"])
    assert result == ({"remi": ["bell.m"]} if target == "bell.m.K" else {})


def test_force_scale_under_automation_apart_from_hand(tmp_path: Path):
    with rig(tmp_path, "firm", SOFT_GROUND.text) as single:
        single.ok("play")
        single.ok("lfo k1.K 1..30 period 2bar now")
        single.run(0.5)
        assert single.scale == 1.0
        asked = single.engine.bounds_finder.n_responses
        single.ok("lfo k1.K 1..40 period 2bar now")
        single.run(0.3)
        assert single.engine.bounds_finder.n_responses <= asked + 1


def test_force_check_with_too_many_values_is_refused(tmp_path: Path):
    values = " ".join(f"{200 + n}N/m" for n in range(65))
    with rig(tmp_path, "firm", SOFT_GROUND.text) as single:
        single.ok("play")
        single.run(0.2)
        reply = single.session.submit(f"set bell.m.K {values} every 1/4 now")
        assert not reply.taken
        assert "the automation of bell.m can change the force on the key of remi" in reply.text
        assert "takes more than 64 combinations of values" in reply.text
