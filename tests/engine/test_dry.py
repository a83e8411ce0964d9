"""DRY, dry friction that turns inside the step: against DOP853 from turn to turn, and its rest."""

import numpy as np
import pytest
from checked import check, codes
from dry_scenes import RATE, SCENES, Dry
from planned_sound import off_db, planned, played, ready
from sweep import few

from ergon import _core

N = 4410  # frames that are judged: 0.1 s


@pytest.fixture(scope="module", params=few(SCENES, ["stick-slip"]))
def solved(request):
    scene = SCENES[request.param]
    return scene, scene.exact(N)


@pytest.mark.parametrize(
    ("asked", "reached"), few([(-60.0, -60.0), (-80.0, -70.0)], [(-60.0, -60.0)])
)
def test_dry_friction_plans_within_requested_error(solved, asked, reached):
    scene, exact = solved
    assert off_db(played(scene.text, error_db=asked)[:N], exact) < reached, scene.name


def test_dry_friction_slide_ends_between_frames():
    """A block that turns some times and stops; no steps of CA that a plan tries are so exact."""
    scene = SCENES["block"]
    exact = scene.exact(N)
    plan = planned(scene.text, error_db=-130.0)[1]
    assert [choice.contact_substeps for choice in plan.choices()] == [2]
    assert off_db(played(scene.text, error_db=-130.0)[:N], exact) < -200.0
    on_frames = [own._replace(contact_substeps=1, oversampling=8) for own in plan.choices()]
    assert off_db(played(scene.text, error_db=-130.0, pins=on_frames)[:N], exact) > -125.0


def test_dry_friction_converges_with_smaller_step(solved):
    """Of order 2 where nothing strikes a resting mass; -90 dB is next to the solver's own turns."""
    scene, exact = solved
    base = planned(scene.text, error_db=-60.0)[1].choices()
    errors = []
    for steps in (1, 4):
        pins = [own._replace(oversampling=steps) for own in base]
        errors.append(off_db(played(scene.text, error_db=-60.0, pins=pins)[:N], exact))
    assert errors[1] < max(errors[0] - 9.0, -90.0), (scene.name, errors)


def test_dry_friction_mass_rests_exactly():
    scene = SCENES["block"]
    sound = played(scene.text, method="ca")[:, 0]
    assert np.ptp(sound[:3000]) > 1e-3
    rest = sound[-4000:]
    assert np.ptp(rest) == 0.0
    assert abs(rest[0]) * 300.0 <= 0.05  # its spring pulls less than friction holds
    assert np.ptp(played(SCENES["held"].text, method="ca")) == 0.0


@pytest.mark.slow
def test_dry_friction_mass_at_rest_under_pressing_contact():
    """Contacts that are computed finer than a frame push before friction answers."""
    text = (
        "ergon: 1\ninstruments:\n  s:\n    modules:\n"
        "      m: {MAS: {M: 100g}}\n      rub: {DRY: {to: m, F: 0.5N}}\n"
        "      h: {CEL: {M: 10g, K: 1N/m, Z: 1Ns/m, X0: -1mm}}\n"
        "      f: {ENF: {to: h, from: 0.2N}}\n"
        "      b: {BUT: {between: [h, m], K: 2kN/m, Z: 1Ns/m}}\n"
        "    out: {SOX: m}\nrender: {tail: 0.5s, bits: float}\n"
    )
    sound = played(text, error_db=-60.0)[:, 0]
    assert np.ptp(sound[-4000:]) < 1e-15


@pytest.mark.parametrize("name", ["block", "stick-slip", "pair", "key"])
def test_dry_friction_ledger_closes_and_only_loses(name: str):
    stage = ready(SCENES[name].text)
    simulation = _core.Simulation(stage.network, stage.timeline, ledger=True)
    lost = 0.0
    for _ in range(50):
        simulation.process(np.empty((220, simulation.n_out)))
        energy = simulation.energy()
        assert abs(energy.residual) <= 1e-12 * energy.flow
        assert energy.lost >= lost - 1e-9 * energy.flow
        lost = energy.lost
    assert lost > 0.0


def test_dry_friction_with_stiff_spring_comes_to_rest():
    """Masses on springs up to the border of stability come to rest, wherever they begin."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        k = float(rng.uniform(1.0, 0.97 * 4.0 * RATE**2 * 1e-3 * 0.9))
        network = _core.Network()
        network.part("p")
        ground = network.sol("g")
        mass = network.mas(
            "m", M=1e-3, X0=float(rng.normal()) * 1e-6, V0=float(rng.normal()) * 1e-2
        )
        network.ref("k", ground, mass, K=k)
        network.dry("rub", ground, mass, F=float(rng.uniform(1.0, 100.0)))
        network.listen("x", positions=[(mass, 1, 1.0)])
        simulation = _core.Simulation(network, _core.Timeline(network, RATE))
        sound = np.empty((3000, 1))
        simulation.process(sound)
        assert np.ptp(sound[-1000:]) == 0.0


@pytest.mark.parametrize("wishes", [{"method": "ca"}, {"error_db": -80.0}])
@pytest.mark.parametrize("name", few(["stick-slip", "key"], 1))
def test_dry_friction_snapshot_continues_bit_identical(name: str, wishes: dict):
    stage, plan = planned(SCENES[name].text, **wishes)
    sound = played(SCENES[name].text, **wishes)
    half = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    half.process(np.empty((stage.n_frames // 2, half.n_out)))
    saved = half.snapshot()
    for _ in range(2):
        tail = np.empty((stage.n_frames - stage.n_frames // 2, half.n_out))
        half.process(tail)
        assert tail.tobytes() == sound[stage.n_frames // 2 :].tobytes()
        half.restore(saved)


GESTURE = (
    "ergon: 1\nrates: {{audio: 44100Hz}}\n"
    "keys:\n  k1:\n    struck: m\n    modules:\n"
    "      m: {{CEL: {{M: 0.4kg, K: 60N/m, Z: 1.2Ns/m}}}}\n"
    "      s: {{MAS: {{M: 20g}}}}\n      a: {{REF: {{between: [m, s], K: 25kN/m, Z: 0.9Ns/m}}}}\n"
    "      rub: {{DRY: {{to: m, F: 50mN{more}}}}}\n"
    "instruments: {{i: {{modules: {{p: {{CEL: {{M: 1kg, f: 20Hz}}}}, "
    "r: {{RES: {{between: [k1, p], K: 1mN/m}}}}}}, out: {{SOX: k1}}}}}}\n"
    "gestures: {{press: {{notation: 0mm@0 {curve} 5mm@1/8 hold 5mm@1/4 {curve} 0mm@3/8, "
    "touch: {touch}}}}}\n"
    "players: {{ada: {{key: k1}}}}\nparts: {{ada: [{{at: 1|1, play: press}}]}}\n"
    "render: {{tail: 0.1s, bits: float}}\n"
)


@pytest.mark.parametrize("more", ["", ", static: 80mN, speed: 4mm/s", ", K: 5kN/m"])
@pytest.mark.parametrize("touch", ["open", "tracked"])
@pytest.mark.parametrize("curve", ["smooth", "line", "throw"])
def test_dry_friction_in_free_copy_of_key(curve: str, touch: str, more: str):
    text = GESTURE.format(curve=curve, touch=touch, more=more)
    sound = played(text, method="ca")[:, 0]
    position = [int(0.125 * RATE + 0.5), int(0.25 * RATE + 0.5)]
    # The load, 1 mN/m, is not in it: 5 uN of some 0.3 N.
    assert sound[position] == pytest.approx(5e-3, abs=1e-6 if "K:" in more else 2e-7)
    if not more:
        held = sound[int(0.15 * RATE) : int(0.24 * RATE)]
        assert np.abs(np.diff(held)).max() < 1e-10


def test_dry_friction_level_automation():
    scene = SCENES["stick-slip"]
    led = "automation: [{at: 1|1, set: s.rub.F, to: 0.5N@0 line 0.1N@1/16}]\n"
    text = scene.text.replace("render:", led + "render:")
    still, moved = (played(one, error_db=-60.0)[4000:] for one in (scene.text, text))
    assert np.abs(moved).max() < 0.6 * np.abs(still).max()


BLOCK = (
    "ergon: 1\ninstruments: {{i: {{modules: {{g: {{SOL: {{}}}}, "
    "m: {{CEL: {{M: 100g, f: 20Hz, X0: 5mm}}}}, "
    "rub: {{DRY: {{{}}}}}}}, out: {{SOX: m}}}}}}\nrender: {{tail: 100ms}}\n"
)


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        ("to: m, F: 0.2N", []),
        ("between: [g, m], F: 0.2N", []),
        ("to: m", ["E103"]),
        ("F: 0.2N", ["E103"]),
        ("to: m, between: [g, m], F: 0.2N", ["E111"]),
        ("to: m, F: 0.2kg", ["E203"]),
        ("to: n, F: 0.2N", ["E301"]),
        ("to: m, F: 0.2N, static: 0.1N", []),
        ("to: m, F: 0.2N, static: 0.1N, K: 1kN/m", ["E111"]),
        ("to: m, F: 0.2N, speed: 1mm/s", ["E111"]),
        ("to: m, F: 0.2N, static: 0.3N, speed: 1mm/s, K: 1kN/m", []),
    ],
)
def test_diagnostics_of_dry_fields(fields: str, found: list[str]):
    assert codes(BLOCK.format(fields)) == found


def test_dry_with_presliding_equals_undamped_bristle():
    fields = "to: m, F: 0.2N, K: 10kN/m, static: 0.3N, speed: 10mm/s"
    bristle = "between: [g, m], sigma0: 10kN/m, Fc: 0.2N, Fs: 0.3N, vs: 10mm/s"
    single, other = BLOCK.format(fields), BLOCK.replace("DRY", "BRISTLE").format(bristle)
    assert np.array_equal(played(single, method="ca"), played(other, method="ca"))


def test_dry_friction_to_ground_equals_fixed_point():
    ground, point = (BLOCK.format(ends + ", F: 0.2N") for ends in ("to: m", "between: [g, m]"))
    assert np.array_equal(played(ground, method="ca"), played(point, method="ca"))


def test_dry_friction_coupling_of_two_keys():
    text = (
        "ergon: 1\nkeys: {k: {M: 100g, K: 10N/m, Z: 0.1Ns/m}, v: {M: 100g, K: 10N/m, X0: 5mm}}\n"
        "instruments: {i: {modules: {m: {CEL: {M: 1g, f: 20Hz}}, "
        "r: {RES: {between: [k, m], K: 0.1N/m}}}, out: {SOX: k}}}\n"
        "duet: [{couple: [k, v], DRY: {F: 1N}}]\nrender: {tail: 0.5s}\n"
    )
    assert check(text).diagnostics == []
    assert 1e-3 < np.ptp(played(text, method="ca")) < 6e-3


def test_dry_friction_reference_closed_form():
    """By closed form: each half swing of a block on a spring is 2F/K shorter."""
    single, k, m = Dry(-1, 0, 0.05), 300.0, 0.01
    exact = SCENES["block"]
    swing = type(exact)("swing", "", ((m, k, 0.0, 1e-3, 0.0, 0.0),), (single,), (0,))
    half = np.pi / np.sqrt(k / m)
    frames = [round(half * RATE), round(2 * half * RATE)]
    result = swing.exact(frames[-1] + 10)[:, 0]
    wanted = [-(1e-3 - 2 * single.F / k), 1e-3 - 4 * single.F / k]
    assert [result[: frames[0] + 9].min(), result[frames[0] :].max()] == pytest.approx(
        wanted, rel=2e-5
    )


def test_dry_friction_turn_within_a_step():
    """A mass swings half a period under the level of fast sliding, and turns where its spring is
    between both levels. It passes the velocities between in 1/70 of a frame.
    """
    text = """\
ergon: 1
rates: {audio: 44100Hz}
instruments:
  s:
    modules:
      m: {CEL: {M: 1g, f: 1200Hz, t60: 60s, X0: 2.7mm}}
      w: {SOL: {}}
      l: {DRY: {between: [m, w], F: 50N, static: 90N, speed: 0.02m/s}}
    out: {SOX: m}
render: {tail: 0.1s}
"""
    stiffness = 1e-3 * (2.0 * np.pi * 1200.0) ** 2
    turn = 2.0 * 50.0 / stiffness - 2.7e-3
    assert 50.0 < -stiffness * turn < 90.0
    for wishes in ({"method": "ca"}, {"error_db": -60.0}):
        sound = played(text, **wishes)
        assert np.ptp(sound[100:]) == 0.0
        assert sound[-1, 0] == pytest.approx(turn, rel=0.02)
