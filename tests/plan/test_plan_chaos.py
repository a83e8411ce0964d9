"""Parts where the smallest difference grows: by waveform until it parts, then by spectrum."""

from pathlib import Path

import numpy as np
import pytest
from commands import records
from sweep import few

from ergon import _core
from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.workshop.lab import metrics
from ergon.workshop.lab.scene import NetworkAndTimeline, Score

RATE = 44_100.0
ASKED_DB = -60.0
STRUCK = 0.02  # [s]
PILOT = 0.3  # [s] after the stroke
# A mallet of 30 g at 0.67 m/s on a plate of 60 g: the tamtam that is bundled, struck hard, and
# heard without the masses that keep its clicks away.
HARD = 20.0
GONG = """\
ergon: 1
accuracy: {{error: {asked}dB}}
instruments:
  gong: {gong}
mix: {{channels: 2}}
strikes: {{a: {{to: [gong.mallet], at: {struck}s, impulse: {impulse}mNs, lasts: 0s}}}}
render: {{tail: 0.5s, bits: float}}
"""
TAMTAM = """
    modules:
      body:
        PLATE: {shape: hex, radius: 9, f: F2, t60: 60s, M: 60g, rim: fixed, hardening: 5e12N/m3}
      mallet: {CEL: {M: 30g, f: 1Hz, t60: 2s}}
      head: {BUT: {between: [mallet, body.centre], K: 2e7, exponent: 1.5, gap: 7mm}}
      wall: {SOL: {}}
      d1: {FRO: {between: [wall, body.60], Z: 10mNs/m}}
      d2: {FRO: {between: [wall, body.200], Z: 10mNs/m}}
    out: {left: {SOF: {FRO: d1}}, right: {SOF: {FRO: d2}}}"""
# A smaller one without hardening, so that only the blow itself is not linear.
LINEAR = TAMTAM
for replaced, by in (
    (", hardening: 5e12N/m3", ""),
    ("{left: {SOF: {FRO: d1}}, right: {SOF: {FRO: d2}}}", "{SOF: {FRO: d1}}"),
    ("radius: 9", "radius: 6"),
    ("body.200", "body.100"),
):
    LINEAR = LINEAR.replace(replaced, by)
OUTPUTS = {"force": LINEAR, "position": LINEAR.replace("{SOF: {FRO: d1}}", "{SOX: body.60}")}
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def score(gong: str = TAMTAM, impulse: float = HARD) -> str:
    return GONG.format(asked=ASKED_DB, gong=gong, struck=STRUCK, impulse=impulse)


def scene(gong: str = TAMTAM, impulse: float = HARD) -> NetworkAndTimeline:
    Path("a.yaml").write_text(score(gong, impulse))
    piece = load("a.yaml").piece
    assert piece is not None
    return Score(piece).build_at(RATE)


def error_of(source: NetworkAndTimeline, **budget: float) -> _core.PlanRow:
    """The row of the gong that has an error."""
    rows = _core.Plan(source.network, source.timeline, **budget).rows()
    return next(row for row in rows if row.error_db is not None)


def finer(plan: _core.Plan) -> list[_core.IslandChoice]:
    """The choices of a plan at twice the rate: contacts at the same instants."""
    return [
        item._replace(
            oversampling=2 * item.oversampling, contact_substeps=max(1, item.contact_substeps // 2)
        )
        for item in plan.choices()
    ]


def play(source: NetworkAndTimeline, plan: _core.Plan) -> metrics.Floats:
    simulation = _core.Simulation(source.network, source.timeline, plan=plan)
    sound = np.empty((round((STRUCK + PILOT) * RATE), simulation.n_out))
    simulation.process(sound)
    return sound


def test_chaotic_gong_judged_by_spectrum():
    gong = scene()
    plan = _core.Plan(gong.network, gong.timeline, error_db=ASKED_DB)
    (row,) = plan.rows()
    assert row.spectral_db is not None
    assert row.spectral_db < 2.0
    # No dearer than by CA, for what is dearer keeps the waveform no longer.
    (choice,) = plan.choices()
    assert choice.counted_cost is not None
    by_ca = _core.Plan(gong.network, gong.timeline, method="ca").rows()[0].cost
    assert row.cost - 1e-9 * choice.counted_cost * RATE == pytest.approx(by_ca)
    half = _core.Plan(gong.network, gong.timeline, error_db=ASKED_DB, pins=finer(plan))
    ours, theirs = play(gong, plan), play(gong, half)
    assert row.error_db is not None
    assert row.error_s is not None
    until = round(row.error_s * RATE)
    assert STRUCK < row.error_s < STRUCK + 0.05
    together = metrics.waveform_db(ours[:until], theirs[:until])
    # That of half the step is counted too, and that of contacts.
    assert together <= row.error_db < together + 10.0
    assert metrics.waveform_db(ours[2 * until :], theirs[2 * until :]) > -3.0
    # The same figure by numpy's transform, of the bands that a pilot is long enough for.
    first = metrics.onset_frame(theirs[: until * 8])
    assert first is not None
    listened = [sound[first:] - sound[first:].mean(axis=0) for sound in (ours, theirs)]
    size = np.linalg.norm(listened[1], axis=0)
    levels = [metrics.third_octaves(sound / size, RATE) for sound in listened]
    wide = 0.2316 * levels[0][0] * len(ours[first:]) / RATE >= 8.0
    apart = np.abs(levels[0][1] - levels[1][1])[wide & (levels[1][1] > levels[1][1].max() - 60)]
    assert row.spectral_db == pytest.approx(float(apart.mean()), abs=0.3)


@pytest.mark.parametrize("listened", few(OUTPUTS, ["position"]))
def test_struck_linear_part_judged_by_waveform(listened: str):
    for impulse in (HARD, 10.0 * HARD):
        row = error_of(scene(OUTPUTS[listened], impulse), error_db=ASKED_DB)
        assert row.spectral_db is None


def test_coarsely_bowed_string_is_judged_by_its_spectrum():
    piece = load(str(Path(__file__).parents[1] / "data" / "pieces" / "hand.yaml")).piece
    assert piece is not None
    hand = Score(piece).build_at(RATE)
    # So coarse a budget that the bow is stepped once a frame.
    rows = _core.Plan(hand.network, hand.timeline, cents=30.0).rows()
    bowed = next(row for row in rows if "bow" in row.parts)
    # Waveforms part, but by a pitch that is a little off, as far as it is and no faster.
    assert bowed.error_db is not None
    assert bowed.error_db > -10.0
    assert all(row.spectral_db is None for row in rows)


@pytest.mark.slow
def test_softly_struck_gong_judged_by_waveform():
    row = error_of(scene(impulse=1.6), error_db=ASKED_DB)
    assert row.spectral_db is None


@pytest.mark.slow
def test_by_ear_the_planner_rejects_a_too_loud_method():
    # At four times the blow CA once a frame is lost, and others come through far too loud.
    gong = scene(impulse=3.0 * HARD)
    plan = _core.Plan(gong.network, gong.timeline)
    row = next(row for row in plan.rows() if row.error_db is not None)
    assert row.spectral_db is not None
    assert row.spectral_db < 2.0
    truth = _core.Plan(
        gong.network,
        gong.timeline,
        method="bm4",
        pins=[(plan.choices()[0].modules, 4, 16, [[1, 2, 2, 0]], None, 4)],
    )
    ours, theirs = play(gong, plan), play(gong, truth)
    assert metrics.bands_db(ours, theirs, RATE) < 4.0


def test_damped_cells_of_a_chaotic_gong_are_not_stepped():
    # All references of this gong are apart by more than the sound. Three damped cells in a row,
    # through which it is heard, are 12 dB too loud by CA at 44.1 kHz, which only modes show.
    Path("a.yaml").write_text(
        "ergon: 1\nuse: [instruments/gong.yaml]\nmix: {channels: 1}\nrender: {tail: 0.5s}\n"
        "strikes: {a: {to: tamtam.mallet, at: 20ms, impulse: 100mNs}}\n"
    )
    piece = load("a.yaml").piece
    assert piece is not None
    source = Score(piece).build_at(RATE)
    rows = _core.Plan(source.network, source.timeline, error_db=ASKED_DB).rows()
    assert [row.what for row in rows].count("complex modes") == 2


@pytest.mark.parametrize("share", [0.05, 0.02])
def test_diverging_part_muted_after_truncated_planning(share: float):
    # At twenty times the blow the first trial leaves all bounds, and the allowance ends with it.
    # What cannot diverge keeps an energy of its own: of 0.2 J its springs have made 400 kJ.
    gong = scene(impulse=20.0 * HARD)
    plan = _core.Plan(gong.network, gong.timeline, share=share)
    assert any(row.cut_short for row in plan.rows())
    playing = _core.Simulation(gong.network, gong.timeline, plan=plan, on_fault="mute")
    playing.process(np.zeros((8000, gong.network.n_out)))
    ((part, frame),) = playing.muted()
    assert part == "gong"
    assert frame < 0.05 * RATE


def test_spectral_error_in_the_record_and_the_cache(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ERGON_CACHE", "on")
    Path("a.yaml").write_text(score())
    assert app.run(["plan", "a.yaml", "--json"]) == 0
    lines = records(capsys)
    (row,) = (line for line in lines if line["event"] == "plan_row")
    assert row["spectral_db"] > 0.0
    text = f"over {row['error_over_s']:.2g} s, then {row['spectral_db']:.1f} dB by spectrum"
    assert app.run(["plan", "a.yaml"]) == 0
    shown = capsys.readouterr()
    assert f"{row['error_db']:.0f} dB {text}" in shown.out
    assert "(from the cache)" in shown.out
    assert "W403" in shown.err
    assert f"the spectra agree within {row['spectral_db']:.1f} dB" in shown.err
    assert app.run(["plan", "a.yaml", "--why", "gong"]) == 0
    assert f"third octaves are right to {row['spectral_db']:.1f} dB" in capsys.readouterr().out
