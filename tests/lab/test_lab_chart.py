"""Charts: orders that are known come out, references know their own error, failures are shown."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ergon import _core
from ergon.scores.reading.load import load
from ergon.workshop.lab import canonical, chart, chart_table, runs
from ergon.workshop.lab.energy import ROUNDING_DB
from ergon.workshop.lab.metrics import waveform_db
from ergon.workshop.lab.names import METHODS, PRECISIONS
from ergon.workshop.lab.reference import find_doubts, ladder, oversamplings, refine
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import BareNetwork, Score

CA = Setting("ca")


def silent(done: int) -> None:
    pass


def grid(upto: int) -> list[Setting]:
    return chart.settings(("ca",), ("f64",), upto)


def sounds(scene: BareNetwork, upto: int, n_frames: int) -> dict[Setting, np.ndarray]:
    return {s: runs.start(scene, s).frames(n_frames) for s in grid(upto)}


# --- running ------------------------------------------------------------------------------------


def test_run_frames_at_same_instants_for_oversampling():
    """A cell alone has exact poles at any rate: every S-th frame is the same sample."""

    def build(network: _core.Network) -> None:
        network.part("p")
        network.listen(
            "m", positions=[(network.cel("m", M=1e-3, f=440.0, t60=1.0, X0=1e-3), 1, 1.0)]
        )

    scene = BareNetwork(build)
    complete = runs.start(scene, CA).frames(1500)
    for times in (2, 3, 8):
        assert np.abs(runs.start(scene, Setting("ca", times)).frames(1500) - complete).max() < 1e-15


@pytest.mark.parametrize("times", [2, 3, 8])
def test_derivative_outputs_same_delay_at_all_rates(times: int):
    """Of a cell alone every rate knows the same positions, so the same is derived from them."""

    def build(network: _core.Network) -> None:
        network.part("p")
        cell = network.cel("m", M=1e-3, f=440.0, t60=1.0, X0=1e-3)
        for name, order in (("x", 0), ("v", 1), ("a", 2)):
            network.listen(name, positions=[(cell, 1, 1.0)], order=order)

    scene = BareNetwork(build)
    once = runs.start(scene, CA).frames(1500)
    run = runs.start(scene, Setting("ca", times))
    often = np.concatenate([run.frames(700), run.frames(800)])
    assert all(waveform_db(often[:, [i]], once[:, [i]]) < -200.0 for i in range(3))


def test_rewound_run_repeats_same_frames():
    run = runs.start(canonical.contact(0.5), Setting("ca", 2))
    first = run.frames(700)
    assert run.cpu_time > 0.0
    run.rewind()
    assert run.cpu_time == 0.0
    assert np.array_equal(run.frames(700), first)


def test_start_refuses_unsupported_settings():
    for setting, message in (
        (Setting("bm5"), "bm5"),
        (Setting("ca", 1, "f8"), "no precision f8"),
        (Setting(None, budget_db=3.0), "error_db cannot be 3"),
        (Setting("modal", budget_db=-60.0), "only one of method, error_db"),
    ):
        with pytest.raises(_core.EngineError, match=message):
            runs.start(canonical.coupled(0.1), setting)


@pytest.mark.parametrize("method", METHODS)
def test_methods_converge_on_linear_and_contact_scenes(method: str):
    """And comes nearer to what the CA scheme says a hundred times finer."""
    for scene, db in ((canonical.coupled(0.1), -40.0), (canonical.contact(0.1), -90.0)):
        truth = runs.start(scene, Setting("ca", 128)).frames(2205)
        result = runs.start(scene, Setting(method, 16)).frames(2205)
        assert waveform_db(result, truth) < db


def test_chart_with_planner_points():
    """By ear two cells and what joins them are two modes; nothing is left to be better at."""
    wanted = [*chart.settings(METHODS, PRECISIONS, 4), *chart.planner_settings(-60.0)]
    result = chart.measure(canonical.coupled(0.1), wanted, 0.1, "waveform", silent)
    points = {str(p.setting): p for p in result.points}
    assert list(points)[-2:] == ["planner", "planner -60 dB"]
    by_ear, budgeted = points["planner"], points["planner -60 dB"]
    assert by_ear.reason == budgeted.reason == "pair: modes"
    for point in (by_ear, budgeted):
        assert point.waveform_db is not None
        assert point.waveform_db < -200.0
        assert not point.on_front  # a star is the planner's, the front is of what one may ask for
    assert result.reference is not None
    assert result.reference.setting.method == "modal"
    assert result.doubts == ()
    head, *rows = (fields for fields in chart_table.csv(result, "x", "y").splitlines()
                   if not fields.startswith("#"))  # fmt: skip
    assert head.startswith("method,oversampling,precision,budget_db,status")
    assert rows[-1].startswith("planner,1,f64,-60,ok")


# --- orders and references ----------------------------------------------------------------------


def test_oversampling_steps_up_to_limit():
    assert oversamplings(8) == (1, 2, 4, 8)
    assert oversamplings(1) == (1,)
    assert oversamplings(6) == (1, 2, 4)


def smooth_string() -> BareNetwork:
    """Let go in the form of its two lowest modes: no partial so high that its phase is lost."""

    def build(network: _core.Network) -> None:
        network.part("p")
        first = network.string("s", masses=40, M=8e-3, f=110.0)
        for i in range(40):
            position = math.pi * (i + 1) / 41
            network.start(
                first + i, 1e-3 * (math.sin(position) + 0.3 * math.sin(2.0 * position)), 0.0
            )
        network.listen("s", positions=[(first + 7, 1, 1.0)])

    return BareNetwork(build)


def test_ca_order_two_on_linear_string():
    """Without losses: with damping on links the order falls to one."""
    result = chart.measure(smooth_string(), grid(8), 0.2, "waveform", silent)
    assert [p.status for p in result.points] == ["ok"] * 4
    assert chart.slope(result, "ca") == pytest.approx(2.0, abs=0.1)
    assert result.reference is not None
    assert result.reference.setting == Setting("ca", 32)
    assert result.reference.order == pytest.approx(2.0, abs=0.1)
    errors = [p.waveform_db for p in result.points]
    assert errors == sorted(errors, reverse=True)
    assert result.floor is not None
    assert result.floor < errors[-1] - 20.0


def test_refine_floor_near_true_error():
    """Against a run far beyond it: within 1 dB on a string, within 10 dB with bounces."""
    for scene, n, slack in ((smooth_string(), 8820, 1.0),
                            (canonical.contact(0.5), 11025, 10.0)):  # fmt: skip
        row = sounds(scene, 16, n)
        result = refine(row, lambda setting: None)
        assert result is not None
        truth = runs.start(scene, Setting("ca", 256)).frames(n)
        assert result.floor_db == pytest.approx(waveform_db(result.sound, truth), abs=slack)


def test_refine_ignores_lucky_last_doubling():
    rng = np.random.default_rng(1)
    noise, x = rng.normal(size=4000), rng.normal(size=4000)
    errors = {1: 1e-1, 2: 5e-2, 4: 2.5e-2, 8: 1.25e-2, 16: 1.2499e-2}  # 16 as wrong as 8
    row = {Setting("ca", s): x + e * noise for s, e in errors.items()}
    result = refine(row, lambda setting: None)
    assert result is not None
    assert result.changes_db[-1] < -110.0
    assert result.floor_db > -55.0


def test_ladder_ends_at_failed_setting():
    x = np.ones(10)
    row = {Setting("ca", s): x for s in (1, 4, 8)}
    assert [s for s, _ in ladder(row, "ca")] == [4, 8]
    assert refine({Setting("ca", 1): x}, lambda setting: None) is None


def test_refine_of_exact_method_without_runs():
    x = np.ones(100)
    row = {Setting("modal", s): x.copy() for s in (1, 2)}
    result = refine(row, lambda setting: pytest.fail("it was refined"))
    assert result is not None
    assert result.order is None
    assert result.floor_db < -300.0


def test_doubts_of_methods_with_different_limits():
    rng = np.random.default_rng(3)
    x, wrong, noise = (rng.normal(size=4000) for _ in range(3))
    row = {Setting("ca", s): x + 1e-3 / s**2 * noise for s in (1, 2, 4, 8)}
    row |= {Setting("bm4", s): x + 1e-4 / s**4 * noise for s in (1, 2, 4, 8)}
    result = refine(row, lambda setting: None)
    assert result is not None
    assert result.setting == Setting("bm4", 8)
    assert find_doubts(row, result) == []
    row |= {Setting("modal", s): x + 1e-2 * wrong for s in (1, 2)}  # sure of itself, and wrong
    result = refine({s: y for s, y in row.items() if s.method != "modal"}, lambda setting: None)
    assert result is not None
    (doubt,) = find_doubts(row, result)
    assert doubt.startswith("modal ×2 and bm4 ×8 differ by -40 dB")


# --- failures -----------------------------------------------------------------------------------


def stiff(factor: float) -> BareNetwork:
    """Two masses on a spring that needs more than the rate: λ = factor·4 at 44.1 kHz."""

    def build(network: _core.Network) -> None:
        network.part("p")
        mass, ground = network.mas("m", M=1e-3, X0=1e-3), network.sol("g")
        network.ref("r", mass, ground, K=4.0 * factor * 1e-3 * 44100.0**2)
        network.listen("m", positions=[(mass, 1, 1.0)])

    return BareNetwork(build)


def test_chart_point_of_refused_setting():
    result = chart.measure(stiff(2.0), grid(8), 0.05, "waveform", silent)
    first, *others = result.points
    assert (first.status, first.cost, first.waveform_db) == ("refused", None, None)
    assert "p.m" in first.reason or "diverge" in first.reason
    assert [p.status for p in others] == ["ok"] * 3
    dearest = others[0].cost
    assert dearest is not None
    likely = chart.likely_cost(result, first)
    assert likely is not None
    assert likely > 0.0


def test_chart_point_of_diverged_run():
    result = chart.measure(canonical.struck(1e4), grid(8), 0.1, "waveform", silent)
    assert [p.status for p in result.points] == ["diverged", "ok", "ok", "ok"]
    assert "the motion of " in result.points[0].reason
    assert " diverged at " in result.points[0].reason


def test_chart_without_reference_after_all_failures():
    result = chart.measure(stiff(100.0), grid(2), 0.05, "waveform", silent)
    assert result.reference is None
    assert {p.status for p in result.points} == {"refused"}
    assert chart.likely_cost(result, result.points[0]) is None
    assert "refused" in chart_table.lines(result)


def test_chart_of_silent_piece_is_refused():
    with pytest.raises(chart.SilentPieceError, match=r"first 0\.05 s"):
        chart.measure(canonical.struck(0.0), grid(2), 0.05, "waveform", silent)


# --- what is best -------------------------------------------------------------------------------


def test_chart_front_of_undominated_points():
    def point(times: int, cost: float, error: float) -> chart.Point:
        return chart.Point(Setting("ca", times), cost=cost, waveform_db=error)

    points = [
        point(1, 1.0, -20.0),
        point(2, 2.0, -19.0),
        point(4, 3.0, -60.0),
        point(8, 4.0, -70.0),
    ]
    front = [p.on_front for p in chart._with_front(points, "waveform", -50.0)]
    assert front == [True, False, True, False]  # below the floor -60 and -70 are alike


def test_chart_front_ignores_timing_noise():
    def point(method: str, cost: float, error: float) -> chart.Point:
        return chart.Point(Setting(method, 1), cost=cost, waveform_db=error)

    # Half a hundredth of the time is no advantage; 20 dB at about the cost are.
    points = [point("ca", 1.0, -20.0), point("ca2p", 0.995, -20.0), point("bm4", 1.05, -40.0)]
    front = [p.on_front for p in chart._with_front(points, "waveform", None)]
    assert front == [False, False, True]
    front = [p.on_front for p in chart._with_front(points[:2], "waveform", None)]
    assert front == [True, False]


def test_chart_methods_with_equal_samples_merged():
    first, two = np.zeros((4, 1)), np.ones((4, 1))
    same = {Setting("ca", 1): first, Setting("ca2p", 1): first, Setting("bm4", 1): two,
            Setting("ca", 2): two, Setting(None): first}  # fmt: skip
    assert chart._identical_methods(same) == (("ca", "ca2p"),)
    points = [
        chart.Point(Setting("ca", 1), cost=2.0, waveform_db=-20.0),
        chart.Point(Setting("ca2p", 1), cost=1.0, waveform_db=-20.0),
    ]
    marked = chart._with_front(points, "waveform", None, (("ca", "ca2p"),))
    assert [p.on_front for p in marked] == [True, False]


def test_chart_energy_metric_is_scheme_production():
    closed = chart.measure(canonical.coupled(0.1), grid(2), 0.05, "energy", silent)
    assert all(p.energy_db is not None and p.energy_db < -130.0 for p in closed.points)
    built = chart.measure(canonical.contact(1.0), grid(2), 0.2, "energy", silent)
    first = built.points[0].energy_db
    assert first is not None
    assert first > -40.0
    assert built.floor == ROUNDING_DB
    assert built.points[0].drift_db_s is not None
    assert abs(built.points[0].drift_db_s) < 10.0
    drifts = [p.drift_db_s for p in closed.points]
    assert all(drift is not None and abs(drift) < 1e-9 for drift in drifts)


def test_score_scene_output_through_mix():
    text = (
        "ergon: 1\n"
        "instruments: {b: {modules: {m: {CEL: {M: 1g, f: 440Hz, t60: 1s}}}, out: {SOX: m}}}\n"
        "strikes: {s: {to: b.m, at: 0.01s, impulse: 1mNs}}\n"
        "mix: {channels: 2, route: [{from: b, to: [1, 2], gain: 6dB}]}\n"
    )
    loaded = load("here.yaml", text=text)
    assert loaded.piece is not None
    scene = Score(loaded.piece)
    frames = runs.start(scene, CA).frames(2000)
    sound = scene.to_sound(frames)
    assert sound.shape == (2000, 2)
    gain = np.abs(sound[:, 0]).max() / np.abs(frames).max()
    assert gain == pytest.approx(10 ** (6 / 20), rel=0.05)  # the high-pass of files shifts a little


def test_chart_energy_of_plan_finer_than_ca_counts_links():
    settings = [Setting("ca", 1), Setting("ca", 2), Setting(None)]
    result = chart.measure(canonical.contact(1.0), settings, 0.2, "energy", silent)
    by_ca, _, by_plan = result.points
    assert by_ca.energy_of == "all"
    assert by_plan.waveform_db < by_ca.waveform_db
    assert (by_plan.energy_of, by_plan.is_bounded) == ("links", True)


def test_chart_energy_of_links_stays_where_motion_differs():
    sound = np.ones((8, 1))
    points = [
        chart.Point(Setting("ca", 1), energy_db=-50.0, drift_db_s=0.1, energy_of="all"),
        chart.Point(Setting(None), energy_db=-math.inf, energy_of="links"),
        chart.Point(Setting(None, budget_db=-60.0), energy_db=-math.inf, energy_of="links"),
    ]
    sounds = {points[0].setting: sound, points[1].setting: sound, points[2].setting: 1.01 * sound}
    as_ca = replace(points[1], energy_db=-50.0, drift_db_s=0.1, energy_of="all")
    assert chart._with_ledger_of_ca(points, sounds) == [points[0], as_ca, points[2]]
    assert chart._with_ledger_of_ca(points, {}) == points


def test_chart_energy_below_rounding_is_a_bound():
    points = [
        chart.Point(Setting("ca", 1), cost=1.0, energy_db=-50.0, energy_of="all"),
        chart.Point(Setting(None), cost=1.0, energy_db=-math.inf, energy_of="links"),
    ]
    marked = chart._with_front(points, "energy", ROUNDING_DB)
    assert [p.is_bounded for p in marked] == [False, True]
