"""Edits of what instruments are made of, and how loud they are."""

import pytest
from edited import DUET, TEMPO, TWO, lines, opened, piece_of, value

from ergon.notation.text.edit import EditError
from ergon.scores.edits import matter


@pytest.mark.parametrize(
    ("path", "target"),
    [
        (DUET, "bell.m.M"),
        (DUET, "bell.m.f"),
        (DUET, "bell.b.K"),
        (DUET, "bell.g.gap"),
        (DUET, "k1.Z"),
        (DUET, "k2.K"),
        (DUET, "gong.f"),
        (DUET, "gong.M"),
        (DUET, "gong.hardening"),
        (DUET, "sky.t60"),
        (TEMPO, "high.hammer.M"),
        (TEMPO, "high.one.t60"),
        (TEMPO, "low.c1.exponent"),
        (TEMPO, "string.felt.K"),
        (TEMPO, "string.body.M"),
        (TEMPO, "k2.M"),
    ],
)
def test_set_value_by_factor_edits_one_line(path, target):
    texts, piece = opened(path)
    after = matter.set_value(texts, piece, target, "x1.5")
    new, old = value(piece_of(after), target), value(piece, target)
    if isinstance(old, tuple):
        assert new == pytest.approx([1.5 * x for x in old])
    else:
        assert new == pytest.approx(1.5 * old, rel=1e-8)
    changed = [lines(texts, after, file) for file in (None, *after.overlay)]
    assert sum(len(added) for _, added in changed) == 1
    assert sum(len(gone) for gone, _ in changed) <= 1


def test_set_value_leaves_other_instruments_unchanged():
    texts, piece = opened(TEMPO)
    after = piece_of(matter.set_value(texts, piece, "high.hammer.M", "9g"))
    assert value(after, "high.hammer.M") == 0.009
    assert value(after, "low.hammer.M") == value(piece, "low.hammer.M") == 0.006


@pytest.mark.parametrize(("target", "other"), [("bell.m.K", "Z"), ("bell.m.Z", "K")])
def test_set_stiffness_replaces_pitch_and_back(target, other):
    texts, piece = opened(DUET)
    after = matter.set_value(texts, piece, target, "x1")
    fields = {name: value(piece_of(after), f"bell.m.{name}") for name in ("M", "K", "Z", "f")}
    assert fields["f"] is None
    # The same cell: sigma and omega of a damped oscillator.
    sigma = fields["Z"] / (2 * fields["M"])
    omega = (fields["K"] / fields["M"] - sigma**2) ** 0.5
    assert omega / (2 * 3.141592653589793) == pytest.approx(220.0, rel=1e-8)
    assert 6.907755278982137 / sigma == pytest.approx(2.5, rel=1e-8)
    back = matter.set_value(after, piece_of(after), "bell.m.f", "x1")
    assert value(piece_of(back), "bell.m.f") == pytest.approx(220.0, rel=1e-8)
    assert value(piece_of(back), "bell.m.t60") == pytest.approx(2.5, rel=1e-8)
    assert value(piece_of(back), "bell.m.K") is None


def test_set_factor_of_measured_key_value():
    texts, piece = opened(DUET)
    measured = value(piece, "k2.M")
    after = piece_of(matter.set_value(texts, piece, "k2.M", "x2"))
    assert value(after, "k2.M") == pytest.approx(2 * measured)


def test_set_of_numbers_under_ca():
    text = (
        "ergon: 1\ninstruments:\n  bell:\n    units: ca\n    at: 44100Hz\n    modules:\n"
        "      m: {CEL: {M: 1, K: 0.001, Z: 1e-5}}\n    out: {SOX: m}\n"
    )
    texts, piece = opened("s.yaml", text)
    after = matter.set_value(texts, piece, "bell.m.K", "x2")
    assert "K: 0.002," in after.text
    assert value(piece_of(after), "bell.m.K") == pytest.approx(0.002)


@pytest.mark.parametrize(
    "target", ["bell.K", "bell.q.K", "bell.m.Q", "nix", "k1", "nix.K", "k1.m.K", "bell.m.K.x", ""]
)
def test_set_of_missing_target_is_refused(target):
    texts, piece = opened(DUET)
    with pytest.raises(EditError):
        matter.set_value(texts, piece, target, "1")


def test_gain_edit_of_routes_and_master():
    texts, piece = opened(TWO)
    after = piece_of(matter.set_gain(texts, "tamtam", "-20dB"))
    gains = {(route.part, route.out): route.gain for route in after.mix.routes}
    assert gains["tamtam", "left"] == gains["tamtam", "right"] == pytest.approx(0.1)
    assert gains["bell", None] != pytest.approx(0.1)
    master = piece_of(matter.set_gain(texts, None, "-20dB")).mix.master
    assert master.gain == pytest.approx(0.1)
    assert len(piece.mix.routes) == len(after.mix.routes)
    with pytest.raises(EditError, match="no route"):
        matter.set_gain(texts, "nix", "-20dB")
