"""`check --simulate` names contacts that a key's first stroke closes, and no other as far."""

from pathlib import Path

import pytest

from ergon.cli import app

Capture = pytest.CaptureFixture[str]

SCORE = """\
ergon: 1
keys: {{k: {{M: 400g, K: 60N/m, Z: 1.2Ns/m}}}}
instruments:
  bell:
    modules:
      ball: {{CEL: {{M: 2g, f: {f}, t60: {t60}{start}}}}}
      body: {{CEL: {{M: 2kg, f: 330Hz, t60: 1s}}}}
      b: {{BUT: {{K: 900N/m, gap: {gap}, between: [k, ball]}}}}
      felt: {{BUT: {{K: 2kN/m, Z: {soft}, gap: 7mm, between: [ball, body]}}}}
    out: {{SOX: body}}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 0mm@1/4
  roll: 0mm@0 (6mm@1/8 0mm@1/4)*4
  fading: 0mm@0 smooth 6mm@1/8 0mm@1/4 3mm@3/8 0mm@1/2 2mm@5/8 0mm@3/4
players: {{ada: {{key: k}}}}
parts: {{ada: [{part}]}}
{more}
render: {{tail: 100ms}}
"""
# The ball stays away.
SLOW = {"f": "0.3Hz", "t60": "9s", "start": "", "gap": "4mm", "soft": "4Ns/m", "more": ""}
QUICK = SLOW | {"f": "20Hz", "t60": "200ms"}
FOUR = "{at: 0, play: knock, every: 1/4, times: 4}"


def named(tmp_path: Path, capsys: Capture, **fields: str) -> list[str]:
    """The contacts of W334."""
    (tmp_path / "s.yaml").write_text(SCORE.format(**fields))
    assert app.run(["check", "--simulate", str(tmp_path / "s.yaml")]) == 0
    output = [line for line in capsys.readouterr().err.splitlines() if "W334" in line]
    return [line.partition("contact '")[2] for line in output]


@pytest.mark.parametrize("part", [FOUR, "{at: 0, play: roll}"], ids=["gestures", "strokes of one"])
def test_contact_missed_by_equal_strokes_is_reported(
    tmp_path: Path, capsys: Capture, part: str
) -> None:
    single, thrown = named(tmp_path, capsys, part=part, **SLOW)
    assert single.startswith("bell.b' closes at 1|1.")
    assert single.endswith(" only, though 3 later strokes of k go as far")
    assert thrown.startswith("bell.felt' closes at 1|1.")


@pytest.mark.parametrize(
    "fields",
    [
        QUICK | {"part": FOUR},
        SLOW | {"part": "{at: 0, play: knock}"},  # it strikes once by design
        SLOW | {"part": "{at: 0, play: fading}"},  # no other goes as far
        SLOW | {"part": FOUR, "gap": "9mm"},  # W320
    ],
    ids=["it comes back", "one stroke", "softer ones", "never"],
)
def test_contact_with_every_stroke_closing_is_not_reported(
    tmp_path: Path, capsys: Capture, fields: dict[str, str]
) -> None:
    assert "bell.b" not in " ".join(named(tmp_path, capsys, **fields))


def test_contact_closed_only_at_the_start_is_reported(tmp_path: Path, capsys: Capture) -> None:
    part = "{at: 0, play: knock, every: 1/4, times: 2}"
    begun = SLOW | {"start": ", X0: -2mm, V0: 0.5m/s", "gap": "1.5mm", "part": part}
    single, *_ = named(tmp_path, capsys, **begun)
    assert single.startswith("bell.b' closes at 1|1 only, though 1 later stroke of k goes")


def test_simulate_ignores_contact_closed_by_other_strike(tmp_path: Path, capsys: Capture) -> None:
    part = "{at: 2, play: knock, every: 1/4, times: 4}"
    struck = "strikes: {s: {to: bell.ball, at: 0, impulse: -10mNs}}"
    assert named(tmp_path, capsys, **SLOW | {"gap": "4mm", "part": part, "more": struck}) == []


def struck(second: str) -> dict[str, str]:
    """Two strikes on the ball, the second against its way; the key reaches it at neither."""
    strikes = (
        "strikes: {s: {to: bell.ball, at: 0, impulse: 5mNs}, "
        f"t: {{to: bell.ball, at: 1/4, impulse: {second}}}}}"
    )
    ringing = SLOW | {"f": "20Hz", "gap": "2m", "soft": "0Ns/m"}
    return ringing | {"part": "{at: 2, play: knock}", "more": strikes}


def test_contact_missed_by_equal_strikes_is_reported(tmp_path: Path, capsys: Capture) -> None:
    (forces,) = named(tmp_path, capsys, **struck("5mNs"))
    assert forces.startswith("bell.felt' closes at 1|1.")
    assert forces.endswith(" only, though 1 later strike on bell.ball is as strong")


@pytest.mark.parametrize("second", ["4.9mNs", "-5mNs"], ids=["softer", "the other way"])
def test_simulate_ignores_contact_missed_by_softer_strikes(
    tmp_path: Path, capsys: Capture, second: str
) -> None:
    assert named(tmp_path, capsys, **struck(second)) == []
