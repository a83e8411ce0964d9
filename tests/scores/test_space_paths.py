"""Gestures of points in space: one path for each axis, mistakes with their places, edits."""

from pathlib import Path

import pytest
from checked import check, check_reports
from sessions import Stepped

from ergon.notation.text.errors import TextError
from ergon.scores.gesture import notation, space_path

PATHS = [
    (
        "(0, 0, 0)@0 smooth (6, 0, 2)@1/4",
        ("0@0 smooth 6@1/4", "0@0 smooth 0@1/4", "0@0 smooth 2@1/4"),
    ),
    ("(1cm,-2um)@+1s", ("1cm@+1s", "-2um@+1s")),
    (
        "(0,0)@0 (line (6, 1)@1/8 hold (6 ,1)@+1/8 | throw ( 0, 0 )@+1/8)*3 smooth (1, 2)@+2",
        (
            "0@0 (line 6@1/8 hold 6@+1/8 | throw 0@+1/8)*3 smooth 1@+2",
            "0@0 (line 1@1/8 hold 1@+1/8 | throw 0@+1/8)*3 smooth 2@+2",
        ),
    ),
]


@pytest.mark.parametrize(("written", "alone"), PATHS)
def test_space_path_parses_into_axes(written: str, alone: tuple[str, ...]):
    assert space_path.axis_count(written) == len(alone)
    for got, text in zip(space_path.parse(written), alone, strict=True):
        plain = notation.parse(text)
        assert [(p.at, p.x, p.curve) for p in got.points] == [
            (p.at, p.x, p.curve) for p in plain.points
        ]
        assert [c.at for c in got.bar_checks] == [c.at for c in plain.bar_checks]
        for point in got.points:  # each is told of by its brackets and its time
            word = written[point.offset : point.offset + point.length]
            assert word[0] == "("
            assert ")@" in word
            assert "@" in word[-6:]


@pytest.mark.parametrize("text", ["0@0 6@1/8", "0@0 (6@1/4 0@1/2)*4", "0@0 6,5@1", "", "(0)@0"])
def test_notation_without_brackets_has_one_axis(text: str):
    assert space_path.axis_count(text) == 1


@pytest.mark.parametrize(
    ("written", "on_fault", "message"),
    [
        ("(0, 0)@0 smooth (6, 0, 2)@1/4", "(6, 0, 2)", "3 positions, and the first has 2"),
        ("(0, 0)@0 6@1/4", "6@1/4", "write one for each axis: (0mm, 0mm)@"),
        ("0@0 (0, 0)@1", "0@0", "this point has one position"),
        ("(0, 0)@0 (6, 0) @1/4", "(6, 0)", "has no time; write (6, 0)@1/4"),
        ("(0, 0, 0, 0)@0", "(0, 0, 0, 0)", "two or three positions, not 4"),
        ("(0, 0)@0 (6, x)@1/4", "x", "'x' is not a position"),
        ("(0, 0)@0 (6, 3s)@1/4", "s)", "does not measure position"),
        ("(0, 0)@1 (6, 1)@1/2", "1/2", "times must rise"),
        ("(0, 0)@0 hold (0, 4)@1/2", "4", "'hold' keeps the position 0mm"),
        ("(0, 0)@0 slow (0, 4)@1/2", "slow", "unknown word"),
        ("(0, 0)@0 (6,)@1/4", "", "the position is missing"),
        ("(0, 0)@0 (6, 1)@", "@", "has no time after its @"),
        ("(0, 0)@0 ((6, 1)@1/4", "(", "this group is not closed"),
    ],
)
def test_space_path_parse_mistake_places(written: str, on_fault: str, message: str):
    with pytest.raises(TextError) as refused:
        space_path.parse(written)
    error = refused.value
    assert message in error.message
    assert written[error.offset :].startswith(on_fault), written[error.offset :]


SCORE = """\
ergon: 1
let: {far: 6mm}
keys:
  east: {M: 300g, K: 80N/m, Z: 2Ns/m}
  north: {M: 300g, K: 80N/m, Z: 2Ns/m}
gestures:
  circle: (0, 0)@0 smooth (far, 0)@1/4 smooth (6, 4)@1/2 smooth (0, 0)@1
  wide: {like: circle, do: [scale 2]}
players: {ada: {key: east}, remi: {key: north}}
parts:
  ada: [{at: 1|1, play: circle.x}]
  remi: [{at: 1|1, play: wide.y circle.y}]
instruments:
  ball:
    space: 2
    modules:
      m: {MAS: {M: 50g, X0: [0, 0]}}
    out: {x: {SOX: m.x}, y: {SOX: m.y}}
  arms:
    modules:
      e: {REF: {between: [east, ball.m.x], K: 1kN/m, Z: 2Ns/m}}
      n: {REF: {between: [north, ball.m.y], K: 1kN/m, Z: 2Ns/m}}
render: {tail: 1s}
"""


def test_part_plays_axis_of_space_path():
    piece = check(SCORE).piece
    assert list(piece.gestures) == ["circle.x", "circle.y", "wide.x", "wide.y"]
    assert [p.x for p in piece.gestures["circle.x"].points] == [0.0, 0.006, 0.006, 0.0]
    assert [p.x for p in piece.gestures["circle.y"].points] == [0.0, 0.0, 0.004, 0.0]
    assert len(piece.gestures["wide.y"].do) == 1


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("play: circle.x", "play: circle", 11, "play one of its axes: circle.x, circle.y"),
        ("play: circle.x", "play: circle.z", 11, "no gesture or take is called 'circle.z'"),
        ("(6, 4)@1/2", "(6, 4mn)@1/2", 7, "unit 'mn' does not measure position"),
        ("(6, 4)@1/2", "(6, 4, 1)@1/2", 7, "this point has 3 positions, and the first has 2"),
    ],
)
def test_space_path_mistakes_in_score(old: str, new: str, line: int, message: str):
    reports = check_reports(SCORE.replace(old, new))
    assert reports
    for _, place, sentence in reports:  # `wide` begins with what is wrong, too
        assert message in sentence
        assert place == line


def test_space_path_defined_played_and_renamed_live(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    try:
        assert (
            "a path in space of 2 points" in stepped.ok("pour = (0, 0)@0 smooth (3, -3)@1/2").text
        )
        stepped.ok("rename circle ring")
        text = stepped.session.schedule.head.texts.text
        assert "play: ring.x" in text
        assert "wide.y ring.y" in text
        assert "like: ring" in text
        assert {"ring.x", "ring.y", "pour.x"} <= check(text).piece.gestures.keys()
        stepped.ok("ada plays pour.x")
        shown = "\n".join(stepped.ok("? pour").lines)
        assert "pour.x on east" in shown
        assert "pour.y on north" in shown or "pour.y on east" in shown
        assert "ada plays pour." in stepped.type("ada plays pour").try_
        stepped.ok("remi plays ring.y")
        stepped.ok("ada plays ring.x")
        stepped.ok("remove pour")
        assert "pour" not in stepped.session.schedule.head.texts.text
    finally:
        stepped.close()
