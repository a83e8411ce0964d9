"""Keys with a calibration: what is played of it, what the key itself writes, and real hands."""

import math
from pathlib import Path

import numpy as np
import pytest

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import stage

MEASURED = """\
ergon: 1
M: 400g
rest: -2.5mm
K: 60N/m
Z: 1.2Ns/m
dry: 50mN
static: 80mN
static_speed: 4mm/s
delay: 1ms
modes:
  - {M: 20g, f: 180Hz, t60: 0.3s}
"""
SCORE = """\
ergon: 1
keys: {{k: {{calib: key.yaml{more}}}}}
instruments:
  far:
    modules: {{m: {{CEL: {{M: 1kg, f: 20Hz}}}}, r: {{RES: {{between: [k, m], K: 1mN/m}}}}}}
    out: {{SOX: k}}
gestures: {{press: {{notation: -2.5mm@0 smooth 5mm@1/8 hold 5mm@1/4 smooth -2mm@3/8{how}}}}}
players: {{ada: {{key: k{hand}}}}}
parts: {{ada: [{{at: 1|1, play: press}}]}}
render: {{tail: 0.5s, bits: float}}
"""


@pytest.fixture
def piece(tmp_path: Path):
    def loaded_piece(measured: str = MEASURED, **fields: str) -> Piece:
        (tmp_path / "key.yaml").write_text(measured)
        text = SCORE.format(**({"more": "", "how": "", "hand": ""} | fields))
        loaded = load(str(tmp_path / "score.yaml"), text=text)
        assert loaded.piece is not None, loaded.diagnostics
        return loaded.piece

    return loaded_piece


def test_calibrated_key_has_all_measured_modules(piece):
    modules = {own.name: own for own in piece().keys["k"].modules}
    kinds = [own.kind for own in modules.values()]
    assert kinds == ["CEL", "MAS", "REF", "SOL", "DRY"]
    cel = modules[""].fields
    assert cel["M"] == pytest.approx(0.38)
    assert (cel["K"], cel["Z"], cel["rest"], cel["X0"]) == (60.0, 1.2, -2.5e-3, -2.5e-3)
    spring = modules["mode 1 spring"].fields
    assert spring["K"] == pytest.approx(0.02 * (2 * math.pi * 180.0) ** 2)
    assert spring["Z"] == pytest.approx(2 * 0.02 * 3 * math.log(10.0) / 0.3)
    dry = modules["dry"].fields
    assert (dry["F"], dry["static"], dry["speed"], dry["K"]) == (0.05, 0.08, 4e-3, None)
    assert piece().keys["k"].measured_constants == (pytest.approx(0.38), 1.2, 1e-3)


def test_calibrated_key_with_simple_option(piece):
    (single,) = piece(more=", simple: true").keys["k"].modules
    fields = {name: single.fields[name] for name in ("M", "K", "Z", "rest", "X0")}
    assert fields == {"M": 0.4, "K": 60.0, "Z": 1.2, "rest": 0.0, "X0": 0.0}


def test_calibrated_key_with_overridden_fields(piece):
    cel = piece(more=", K: 80N/m, rest: 1mm, X0: 0mm").keys["k"].modules[0].fields
    assert (cel["M"], cel["K"]) == (pytest.approx(0.38), 80.0)
    assert (cel["rest"], cel["X0"]) == (1e-3, 0.0)


@pytest.mark.parametrize("touch", ["open", "tracked"])
@pytest.mark.parametrize("curve", ["smooth", "throw"])
def test_gestures_on_calibrated_key_reach_their_points(piece, touch: str, curve: str):
    how = f", touch: {touch}"
    text = piece(how=how)
    built = stage(text)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    position = [round(when * 44100) for when in (0.125, 0.25)]
    assert sound[position, 0] == pytest.approx(5e-3, abs=2e-7)
    # Let go at -2 mm it rests there: its spring pulls 30 mN, and friction holds up to 80 mN.
    assert np.ptp(sound[-2000:, 0]) < 1e-9
    assert sound[-1, 0] == pytest.approx(-2e-3, abs=5e-5)


def test_live_hand_takes_struck_mass_only(piece):
    text = piece(hand=", hand: live")
    complete = stage(text)
    real = stage(text, real_hands={"ada": np.zeros(500)})
    # What swings, the ground, and the point at which the piece's forces wait for the motor.
    assert complete.network.n_mat - real.network.n_mat == 3
    assert complete.network.n_lia - real.network.n_lia == 2
    assert real.live_hands[0].mat == 0


def test_live_hand_receives_measured_values(piece, monkeypatch: pytest.MonkeyPatch):
    from ergon.live import perform

    output = []

    class Stop(Exception):
        pass

    def performance(*_: object, hands: list[_core.LiveHand], **__: object) -> None:
        output.extend(hands)
        raise Stop

    monkeypatch.setattr(perform._core, "Performance", performance)
    built = stage(piece(hand=", hand: live"), real_hands={"ada": None})
    with pytest.raises(Stop):
        perform.perform(built, perform.PlaybackConfig())
    assert [hand.measured for hand in output] == [(pytest.approx(0.38), 1.2, 1e-3)]


def played_positions(piece: Piece) -> np.ndarray:
    """Positions of the key at each frame [m]."""
    built = stage(piece)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound[:, 0]


def test_key_weight_balanced_by_spring(piece):
    """150 mN on 60 N/m are 2.5 mm: the key is the one that was measured there."""
    by_weight = played_positions(piece(MEASURED.replace("rest: -2.5mm", "weight: 150mN")))
    assert by_weight[0] == pytest.approx(-2.5e-3, abs=1e-12)
    assert np.array_equal(by_weight, played_positions(piece()))


HEAVY = "ergon: 1\nM: 400g\nK: {stiffness}\nZ: 1.2Ns/m\nweight: {weight}\ndry: 20mN\n"


@pytest.mark.parametrize(("weight", "end"), [("150mN", -15e-3), ("-150mN", 15e-3)])
def test_key_weight_without_spring_falls_to_travel_end(piece, weight: str, end: float):
    """Let go at rest it falls by the closed form of a constant force against a damper, and stays
    on the end.
    """
    measured = HEAVY.format(stiffness="0N/m", weight=weight) + "travel: -15mm..15mm\n"
    x = played_positions(piece(measured))
    assert x[0] == pytest.approx(end, abs=1e-9)
    let_go = round(0.375 * 44100)
    assert x[let_go] == pytest.approx(-2e-3, abs=1e-6)
    t = np.arange(4410) / 44100
    settling, speed = 0.4 / 1.2, math.copysign((0.15 - 0.02) / 1.2, end)
    fallen = speed * (t - settling * (1.0 - np.exp(-t / settling)))
    assert x[let_go : let_go + 4410] - x[let_go] == pytest.approx(fallen, abs=3e-6)
    assert np.ptp(x[-2000:]) < 1e-9
    # Friction of 20 mN holds it within 1 µm of the place where the end carries the weight.
    assert x[-1] == pytest.approx(end, abs=1.1e-6)


def test_heavy_key_on_weak_spring_rests_on_end(piece):
    measured = HEAVY.format(stiffness="3N/m", weight="150mN") + "travel: -15mm..15mm\n"
    cel, *_, weight = piece(measured).keys["k"].modules
    assert (cel.fields["X0"], cel.fields["rest"]) == (-15e-3, 0.0)
    assert (weight.kind, weight.fields["from"]) == ("ENF", -0.15)


def test_standin_path_of_heavy_key(piece):
    """The path of a part on a real key comes from the key alone: its weight is in it."""
    measured = HEAVY.format(stiffness="0N/m", weight="150mN") + "travel: -15mm..15mm\n"
    text = piece(measured, hand=", hand: live")
    (hand,) = stage(text, real_hands={"ada": None}).live_hands
    written = played_positions(piece(measured))[:: hand.tick_frames]
    n = min(len(written), len(hand.standin_path))
    assert np.abs(hand.standin_path[:n] - written[:n]).max() < 2e-6


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        ("static: 80mN", "weight: 150mN", "E111"),
        ("M: 20g, f", "M: 500g, f", "E202"),
        ("static: 80mN", "static: 30mN\npresliding: 1kN/m", "E111"),
    ],
)
def test_calibration_mistakes_are_placed_in_its_file(
    tmp_path: Path, before: str, after: str, code: str
):
    (tmp_path / "key.yaml").write_text(MEASURED.replace(before, after))
    text = SCORE.format(more="", how="", hand="")
    result = load(str(tmp_path / "score.yaml"), text=text).diagnostics
    assert [(one.code, Path(one.place.file).name) for one in result] == [(code, "key.yaml")]


def test_key_weight_without_spring_or_travel_is_refused(tmp_path: Path):
    (tmp_path / "key.yaml").write_text(HEAVY.format(stiffness="0N/m", weight="150mN"))
    text = SCORE.format(more="", how="", hand="")
    (mistake,) = load(str(tmp_path / "score.yaml"), text=text).diagnostics
    assert mistake.code == "E103"
    assert "write `travel`" in mistake.message
    assert load(
        str(tmp_path / "score.yaml"), text=text.replace("key.yaml", "key.yaml, travel: -9mm..9mm")
    ).piece
