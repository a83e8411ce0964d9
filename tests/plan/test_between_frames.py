"""Contacts and single laws that a plan computes between frames, against their exact motion."""

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from accuracy import audit
from accuracy.__main__ import NAMED
from sweep import few

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.staging import planning
from ergon.scores.staging.preparing import prepare
from ergon.scores.staging.stage import Stage

PIECES = Path(__file__).parents[1] / "data" / "pieces"
CONTACTS = ["hammer-0", "multi-0", "multi-14"]
MORE_CONTACTS = [*(f"hammer-{i}" for i in (6, 9, 15, 17, 20, 24)), "multi-16"]
LAWS = ["laws-10", "laws-23", "hard-7", "hard-8"]


def piece_of_data(name: str) -> Stage:
    piece = load(str(PIECES / f"{name}.yaml")).piece
    assert piece is not None
    return prepare(piece)


def named(name: str) -> str:
    return (NAMED / f"{name}.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", few([*CONTACTS, *MORE_CONTACTS], 1))
def test_contacts_error_by_ear_and_at_80_db(name: str):
    by_ear, asked = audit.look(name, named(name), (audit.BY_EAR, -80.0), plain=False).plans
    assert by_ear.audible <= 1.0
    assert asked.real <= -80.0
    assert not asked.warned


@pytest.mark.parametrize("name", ["hammer-0", "multi-14"])
def test_plain_and_exact_contact_planned_alike(name: str):
    """A plan chooses the way, not the word: the same samples to the last bit."""
    text = named(name)
    sounds = []
    for word in ("plain", "exact"):
        piece = load("scene.yaml", text=text.replace("contact: exact", f"contact: {word}")).piece
        assert piece is not None
        ready = prepare(piece)
        plan = planning.make_plan(ready.network, ready.timeline, Accuracy(error=-60.0)).plan
        simulation = _core.Simulation(ready.network, ready.timeline, plan=plan)
        sound = np.empty((4000, simulation.n_out))
        simulation.process(sound)
        sounds.append(sound)
    assert np.array_equal(*sounds)


@pytest.mark.parametrize("name", few(LAWS, 1))
def test_single_laws_reach_80_db(name: str):
    (asked,) = audit.look(name, named(name), (-80.0,), plain=False).plans
    assert asked.is_met


@pytest.mark.parametrize("name", few(LAWS, 1))
def test_single_law_cost_within_documented_factor(name: str):
    """Five times what CA takes at most, by the table of costs (docs/numerics.md)."""
    result = audit.look(name, named(name), (-80.0,))
    (asked,) = result.plans
    plain = next(one for one in result.plain if (one.method, one.times) == ("ca", 1))
    assert asked.cost <= 5.0 * plain.cost


@pytest.mark.slow
@pytest.mark.parametrize(
    "slope", few(["F: 11.025, s: 0.01", "F: 0.11, s: 0.001"], ["F: 0.11, s: 0.001"])
)
def test_steep_friction_solved_between_frames(slope: str):
    """It was refused; the first holds its string, the second slips."""
    text = named("stability-fric-5").replace("F: 11.025, s: 0.01", slope)
    for plan in audit.look("stability-fric-5", text, (audit.BY_EAR, -60.0), plain=False).plans:
        assert not plan.refused
        assert plan.render_error <= -40.0
    assert plan.render_error <= -60.0


@pytest.mark.parametrize(
    "name", few([f"stability-fric-{i}" for i in (10, 12, 13)], ["stability-fric-10"])
)
def test_steep_bow_stick_and_slip_within_error(name: str):
    """Newton's steps do not end on such slopes; the motion was 100 times as large."""
    (asked,) = audit.look(name, named(name), (-60.0,), plain=False).plans
    assert not asked.refused
    assert asked.render_error <= -60.0


def test_contact_substeps_limited_in_chaotic_motion():
    """Doublings end where they gain nothing; the plan says until when it holds."""
    piece = load("scene.yaml", text=named("key-16")).piece
    assert piece is not None
    ready = prepare(piece)
    first, *_ = _core.Plan(ready.network, ready.timeline, error_db=-60.0).rows()
    assert first.contact_substeps <= 16
    assert first.spectral_db is not None
    assert first.error_db is not None
    assert first.error_db <= -60.0


@pytest.mark.slow
def test_alternating_contacts_plan_terminates():
    """Two keys, a bell and a tamtam: two contacts took turns for ever, and the plan never came."""
    ready = piece_of_data("two-keys")
    rows = _core.Plan(ready.network, ready.timeline, error_db=-60.0).rows()
    assert rows[0].contact_substeps == 2


def test_stiffest_contact_plays_to_end():
    """K·T²/m is 1e6: the contact lasts a 300th of a frame. An explicit step would diverge."""
    result = audit.look("but-1e6", named("but-1e6"), (audit.BY_EAR, -60.0), plain=False)
    assert not any(plan.refused for plan in result.plans)


@pytest.mark.parametrize("name", ["hard-7", "hard-8"])
def test_method_by_name_used_or_refused(name: str):
    """Neither CA in its name where a law's force is heard, nor where it is not."""

    def plan(text: str) -> _core.Plan:
        piece = load("scene.yaml", text=text).piece
        assert piece is not None
        ready = prepare(piece)
        return _core.Plan(ready.network, ready.timeline, method="bm4")

    text = named(name)
    with pytest.raises(_core.EngineError, match="the method bm4 cannot compute this link"):
        plan(text)
    silent = re.sub(r", o1: {SOF: {LNL: l}}", "", text).replace(", {from: s.o1, to: [2]}", "")
    assert [row.what for row in plan(silent).rows()] == ["bm4"]


@pytest.mark.parametrize(
    ("masses", "contact"), few(product([24, 48], [(2e5, 0.0), (2e4, 0.05)]), 1)
)
def test_string_on_twelve_point_obstacle_within_error(masses: int, contact: tuple[float, float]):
    """A curved bridge that a quarter or half of the masses meet: one contact of many points."""
    stiffness, viscosity = contact
    modules = [f"b: {{STRING: {{masses: {masses}, M: 4g, f: 110.0Hz, t60: 3.0s, ends: fixed}}}}"]
    for i in range(12):
        height = -1e-5 - 2e-6 * (i - 4) ** 2
        fields = f"K: {stiffness}N/m, Z: {viscosity}Ns/m, side: above"
        modules.append(f"g{i}: {{SOL: {{X0: {height}m}}}}")
        modules.append(f"c{i}: {{BUT: {{between: [b.{i}, g{i}], {fields}}}}}")
    text = (
        "ergon: 1\nrates: {audio: 44100Hz}\ninstruments:\n  s:\n    modules:\n"
        + "".join(f"      {module}\n" for module in modules)
        + "    out: {SOX: b.5}\n"
        "strikes: {k: {to: s.b.20, at: 0.001s, impulse: -0.0012Ns}}\n"
        "render: {bits: float, tail: 0.1s}\n"
    )
    (plan,) = audit.look("bridge", text, (-80.0,), plain=False).plans
    assert plan.render_error <= -80.0


@pytest.mark.parametrize("rate", [8000, 12000])
def test_strike_on_mode_at_multiple_of_half_the_rate(rate: int):
    """Samples of a mode of 12 kHz are 0 at these rates. The contact is near, but stays open at
    first, so the sound is that of the body alone, whose modes are exact."""

    def sound(modules: str) -> np.ndarray:
        text = (
            f"ergon: 1\nrates: {{audio: {rate}Hz}}\ninstruments:\n  s:\n    modules:\n"
            "      skin: {MODES: {M: 0.15kg, f: [100Hz, 2950Hz, 12kHz], t60: [0.2s, 0.1s, 0.5s],"
            " places: {struck: [1, 1, 1]}}}\n"
            f"{modules}    out: {{SOX: skin.struck}}\n"
            "strikes: {k: {to: s.skin.struck, at: 50ms, impulse: 1Ns}}\n"
            "render: {bits: float, tail: 0.1s}\n"
        )
        piece = load("scene.yaml", text=text).piece
        assert piece is not None
        stage = prepare(piece)
        stage.timeline.open()
        plan = _core.Plan(stage.network, stage.timeline, cents=3.0)
        simulation = _core.Simulation(stage.network, stage.timeline, plan=plan)
        frames = np.empty((rate * 52 // 1000, simulation.n_out))
        simulation.process(frames)
        return frames

    alone = sound("")
    beside_hammer = sound(
        "      hammer: {CEL: {M: 30g, f: 2.5Hz, t60: 0.15s}}\n"
        "      contact: {BUT: {between: [hammer, skin.struck], K: 5.8e6, exponent: 1.77, "
        "gap: 0.3mm}}\n"
    )
    assert abs(beside_hammer - alone).max() <= 1e-9 * abs(alone).max()
