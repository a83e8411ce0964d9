"""Bells as instruments: what is rendered of them has their modes, and a table makes one."""

import json
from pathlib import Path

import numpy as np
import pytest
from checked import check
from scipy.io import wavfile
from sweep import few

import ergon
from ergon.cli import app
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage
from ergon.workshop.bells.bell import bell_from_table
from ergon.workshop.bells.chain import build_chain
from ergon.workshop.bells.contact import DEFAULT_CONTACT_DURATION, spectrum
from ergon.workshop.bells.instrument import FormError, text
from ergon.workshop.bells.resonances import TableError, read
from ergon.workshop.bells.stroke import read as sound_of

F = (219.0, 219.6, 440.0, 657.0, 1320.0)
T60 = (3.0, 2.7, 2.0, 1.2, 0.6)
LEVELS = (1.0, 0.8, -0.6, 0.5, 0.3)
SCORE = """ergon: 1
use: [bell.yaml]
instruments:
  b: {from: bell/bell}
strikes: {s: {to: %s, at: 0.05s, impulse: 10mNs}}
render: {tail: 4s}
"""

PLAYED = """ergon: 1
use: [bell.yaml]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  b: {from: bell/bell, f: A3}
  action: {modules: {c: {BUT: {between: [k1, b.hammer], K: 4kN/m, Z: 2Ns/m}}}}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock}]}
render: {tail: 0.5s}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ERGON_CACHE", "off")


def run(words: list[str]) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        app.main(words)
    return int(ended.value.code or 0)


def even(f: np.ndarray) -> np.ndarray:
    """Decays [s] that dampers beside all springs and masses make."""
    return 3 * np.log(10) / (0.5 + 1e-7 * (2 * np.pi * f) ** 2)


def written_bell(form: str = "modes") -> ergon.Bell:
    rows = [(f, t60, abs(a)) for f, t60, a in zip(F, T60, LEVELS, strict=True)]
    bell = bell_from_table(rows)
    Path("bell.yaml").write_text(text(bell, form=form))
    return bell


@pytest.mark.slow
@pytest.mark.parametrize(("form", "to"), [("modes", "b.point"), ("chain", "b.m1")])
def test_bell_analysis_recovers_modes_of_rendered_bell(form: str, to: str) -> None:
    if form == "chain":
        f, level = np.array(F[1:]), np.array([0.8, 0.6, 0.5, 0.3])
        t60 = even(f)
        bell = bell_from_table(list(zip(f, t60, level, strict=True)))
        Path("bell.yaml").write_text(text(bell, form=form))
    else:
        written_bell(form)
        f, t60, level = np.array(F), np.array(T60), np.abs(LEVELS)
    Path("s.yaml").write_text(SCORE % to)
    assert run(["render", "s.yaml", "-o", "s.wav", "-q"]) == 0
    result = ergon.bell("s.wav", ergon.BellOptions(modes=len(f)))
    assert len(result.f) == len(f)
    assert 1200 * np.abs(np.log2(result.f / f)).max() < (1e-3 if form == "modes" else 0.1)
    assert result.t60 == pytest.approx(t60, rel=1e-3 if form == "modes" else 0.12)
    listened = np.abs(result.levels[:, 0] * result.listening_levels)
    assert listened == pytest.approx(level / level.max(), rel=0.02)
    assert result.strokes[0].explained > 0.9999


@pytest.mark.slow
def test_bell_forms_played_by_key(capsys: pytest.CaptureFixture[str]) -> None:
    for form in ("modes", "cels"):
        written_bell(form)
        Path("s.yaml").write_text(PLAYED)
        assert run(["render", "s.yaml", "-o", f"{form}.wav", "-q"]) == 0
        blocks = ergon.render("s.yaml").frames
        assert np.abs(blocks).max() > 0.0


def recorded(peak: float) -> ergon.Bell:
    """A bell from a recording that begins with so much of full scale."""
    t = np.arange(2 * 44100) / 44100
    modes = zip(F, T60, LEVELS, strict=True)
    ring = sum(
        abs(a) * np.exp(-3 * np.log(10) / t60 * t) * np.sin(2 * np.pi * f * t)
        for f, t60, a in modes
    )
    sound = np.concatenate([np.zeros(441), peak / np.sum(np.abs(LEVELS)) * ring])
    sound += 1e-6 * np.random.default_rng(0).standard_normal(sound.size)
    wavfile.write("stroke.wav", 44100, sound.astype(np.float32))
    bell = ergon.bell("stroke.wav")
    Path("bell.yaml").write_text(text(bell))
    return bell


@pytest.mark.parametrize("peak", few([0.8, 0.05], 1))
def test_bell_hammer_level_equals_recording_level(peak: float) -> None:
    bell = recorded(peak)
    assert bell.reference == pytest.approx(peak / np.sum(np.abs(LEVELS)), rel=0.01)
    Path("s.yaml").write_text(
        "ergon: 1\nuse: [bell.yaml]\ninstruments:\n  b:\n    from: bell/bell\n    modules: "
        "{hammer: {CEL: {M: 8g, f: 1Hz, t60: 2s, V0: 1m/s}}}\nrender: {tail: 0.5s}\n"
    )
    assert run(["render", "s.yaml", "-o", "s.wav", "-q"]) == 0
    again = ergon.bell("s.wav", ergon.BellOptions(modes=len(F)))
    listened = np.abs(again.levels[:, 0] * again.listening_levels) * again.reference
    # The hammer is hard, and yet leaves a little less of high modes than a blow without length.
    wanted = (
        np.abs(LEVELS)
        * peak
        / np.sum(np.abs(LEVELS))
        * spectrum(np.array(F), DEFAULT_CONTACT_DURATION)
    )
    assert listened == pytest.approx(wanted, rel=0.1)


@pytest.mark.slow
def test_bell_of_loud_recording_without_gain_warning(
    capsys: pytest.CaptureFixture[str],
) -> None:
    recorded(0.5)
    Path("s.yaml").write_text(PLAYED)
    assert run(["render", "s.yaml", "-o", "s.wav"]) == 0
    assert "W325" not in capsys.readouterr().err
    assert 0.02 < np.abs(sound_of(Path("s.wav"))[0]).max() < 1.0


def test_bell_contact_stiffness_at_haptic_key() -> None:
    """Whatever the level of the microphone: what a hand gets is computed from this answer."""
    recorded(0.5)
    Path("s.yaml").write_text(PLAYED)
    piece = load("s.yaml").piece
    assert piece is not None
    network = stage(piece).network
    key = next(i for i in range(network.n_mat) if network.name_of(i) == "k1")
    forces = network.reachable_network(key, 44100.0).response(44, (400, 4096))
    assert forces is not None
    assert 3900.0 < np.abs(forces).max() < 4100.0


def test_chain_refused_for_beats_and_above_15_modes() -> None:
    with pytest.raises(FormError, match="beat"):
        written_bell("chain")
    many = [(100.0 * 1.1**i, 1.0, 1.0) for i in range(16)]
    with pytest.raises(FormError, match="at most 15"):
        text(bell_from_table(many), form="chain")


def test_chain_end_has_modes_and_levels() -> None:
    f = np.array([200.0, 540.0, 1100.0])
    t60 = even(f)
    level = np.array([1.0, 0.5, 0.3])
    single = build_chain(f, t60, level, 0.1)
    stiffness = np.diag(single.springs) + np.diag(np.r_[0, single.springs[:-1]])
    stiffness -= np.diag(single.springs[:-1], 1) + np.diag(single.springs[:-1], -1)
    root = 1 / np.sqrt(single.masses)
    values, vectors = np.linalg.eigh(root[:, None] * stiffness * root)
    sigma = 3 * np.log(10) / t60
    assert values == pytest.approx((2 * np.pi * f) ** 2 + sigma**2, rel=1e-9)
    assert vectors[0] ** 2 == pytest.approx(level / level.sum(), rel=1e-9)


MODALYS = """; a clarinet, as ModRes wrote it
1 465.239 -55.16879 .2261643
2 1621.073 -66.87767 .5535431
3\t1923.595\t-67.9138\t.6310855
"""


def test_read_table_of_resonances() -> None:
    Path("r.txt").write_text(MODALYS)
    rows = read(Path("r.txt"))
    assert rows[0] == pytest.approx(
        (465.239, 6.907755 / (np.pi * 0.2261643), 10**-2.7584395), rel=1e-6
    )
    Path("linear.txt").write_text("100 1.0 0.5\n200 0.25 0.5\n300 0 1\n")
    assert [row[2] for row in read(Path("linear.txt"))] == [1.0, 0.25]
    bell = ergon.bell("r.txt")
    Path("bell.yaml").write_text(text(bell))
    assert check(Path("bell.yaml").read_text()).diagnostics == []


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ("", "no resonances"),
        ("1 2\n", "r.txt:1: .* 2 words"),
        ("1 220 0.5 x\n", "not three numbers"),
        ("1 220 0.5 0\n", "bandwidth of 0"),
        ("1 -220 0.5 1\n", "frequency of -220"),
        ("1 nan 0.5 1\n", "finite"),
        ("1 220 0 1\n", "all amplitudes are 0"),
    ],
)
def test_read_table_with_mistake_names_its_line(table: str, reason: str) -> None:
    Path("r.txt").write_text(table)
    with pytest.raises(TableError, match=reason):
        read(Path("r.txt"))


def test_bell_refuses_wrong_options() -> None:
    for options, strokes in (
        (ergon.BellOptions(modes=0), "a.wav"),
        (ergon.BellOptions(), []),
        (ergon.BellOptions(), {"last": ["a.wav"]}),
        (ergon.BellOptions(), {"rim": ["a.txt", "b.wav"]}),
    ):
        with pytest.raises(ergon.OptionError):
            ergon.bell(strokes, options)


def test_bell_command_writes_instrument_and_reports(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("r.txt").write_text(MODALYS)
    assert run(["bell", "r.txt", "-o", "bell.yaml"]) == 0
    out = capsys.readouterr()
    assert "465.239 Hz" in out.out
    assert "wrote bell.yaml" in out.err
    assert run(["bell", "r.txt", "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert rows[0]["frequency_hz"] == 465.239
    assert run(["bell", "rim=nothing.wav"]) != 0
    assert "nothing.wav" in capsys.readouterr().err
    Path("noise.wav").write_bytes(b"RIFF")
    assert run(["bell", "noise.wav"]) != 0
    assert "Traceback" not in capsys.readouterr().err
