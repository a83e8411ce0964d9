"""The pitch of a whole instrument, and of a BANK: set and led at the prompt and in scores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from edited import opened
from sessions import Stepped

from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.load import load
from ergon.scores.staging.automating import value_on_beat
from ergon.scores.staging.parameter_values import AutomatedModule
from ergon.scores.staging.stage import stage
from tests.repl.test_repl_glides import pitch

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: {bpm: 240}
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      hammer: {CEL: {M: 9g, f: 2Hz, t60: 1s}}
      m: {CEL: {M: 20g, f: A3, t60: 9s, X0: 1mm}}
      low: {CEL: {M: 20g, K: 900N/m, Z: 0.01Ns/m}}
      s: {STRING: {masses: 9, M: 5g, f: 300Hz, t60: 4s}}
      some: {BANK: {count: 3, M: 20g, f: 200Hz..900Hz, t60: 4s}}
      r: {REF: {between: [low, s.3], K: 90N/m, Z: 0.1Ns/m}}
      b: {BUT: {between: [hammer, m], K: 900N/m, exponent: 1.5, gap: 9mm}}
      slide: {LNL: {between: [k, hammer], damping: 0.1*v}}
    f: A3
    out: {SOX: m}
  bell2: {like: bell, f: C4}
  sky: {BANK: {count: 3, M: 20g, f: 200Hz..900Hz, t60: 4s}, out: {SOX: sky.all}}
  hard: {f: A3, modules: {m: {CEL: {M: 2g, f: A3}}, n: {LNL: {between: [k, m], law: 3*d}}}}
gestures: {knock: 0mm@0 smooth 3mm@1/8 throw 0mm@1/4}
players: {ada: {key: k}}
parts: {ada: []}
mix: {channels: 2, route: [{from: bell, to: 1}, {from: bell2, to: 2}, {from: sky, to: 2}]}
render: {bits: float, tail: 8s}
"""
MOVED = ("m", "low", "s", "some", "r", "b")


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    yield stepped
    stepped.close()


def numbers(piece, part):
    return {
        module.name: AutomatedModule.from_piece(piece, (part, module.name)).written_engine_values
        for module in piece.instruments[part].modules
        if module.name in MOVED
    }


def staged(text, tmp_path):
    path = tmp_path / "led.yaml"
    path.write_text(text)
    return stage(load(path).piece)


@pytest.mark.parametrize("part", ["bell", "bell2"])
@pytest.mark.parametrize("to", ["C5", "x1.25", "C4@0 smooth C5@2"])
def test_instrument_pitch_glide_ends_as_transposed_instrument(tmp_path, part, to):
    over = "" if "@" in to else ", over: 1bar"
    line = f"automation: [{{at: 1|1, set: {part}.f, to: {to}{over}}}]\n"
    led = staged(SCORE + line, tmp_path)
    piece = led.piece
    begun = piece.instruments[part].pitch
    end = value_on_beat(piece, (part, ""), "f", 99.0)
    assert {name for own, name in led.paths if own == part} == {*MOVED}  # no hammer, no friction
    text = SCORE.replace("    f: A3\n", f"    f: A3\n    transpose: x{end / begun!r}\n")
    if part == "bell2":
        text = SCORE.replace("f: C4}", f"f: {end!r}Hz}}")
    wanted = numbers(piece_of(Texts(str(tmp_path / "x.yaml"), text)), part)
    for name in MOVED:
        module = AutomatedModule.from_piece(piece, (part, name)).module
        alone = [1.0, 1.0] if module.kind != "CEL" else wanted[name]
        if module.kind != "CEL":  # factors
            ratio = end / begun
            alone = [ratio * ratio, ratio]
        assert led.paths[part, name][-1][1:] == pytest.approx(tuple(alone), rel=1e-9), name


def test_instrument_pitch_glide_times_module_pitch_glide(tmp_path):
    lines = "automation:\n  - {at: 1|1, set: bell.f, to: A4, over: 1bar}\n"
    lines += "  - {at: 1|1, set: bell.m.f, to: C4, over: 2bar}\n"
    led = staged(SCORE + lines, tmp_path)
    k, _, m = led.paths["bell", "m"][-1][1:]
    assert np.sqrt(k / m) / (2 * np.pi) == pytest.approx(2 * 261.6256, rel=1e-4)


@pytest.mark.slow
def test_set_instrument_pitch_over_bar_live_and_saved(stepped_session, tmp_path):
    stepped_session.ok("play from 1|1")
    stepped_session.ok("set bell.f A4 over 1bar\nada plays knock every 1")
    stepped_session.run(3.5)
    rate = stepped_session.rate
    assert pitch(
        stepped_session.sound[int(0.2 * rate) : int(0.9 * rate), 0], rate
    ) == pytest.approx(220, rel=0.01)
    assert pitch(stepped_session.sound[int(2.5 * rate) :, 0], rate) == pytest.approx(
        440.0, rel=0.01
    )
    stepped_session.ok("keep 1bar as verse\nsave typed")
    for name in ("typed", "verse"):
        _, piece = opened(str(stepped_session.journal.with_name(f"{name}.yaml")))
        assert value_on_beat(piece, ("bell", ""), "f", 99.0) == pytest.approx(440.0)
    stepped_session.ok("set bell.f x1.5 over 1bar")
    stepped_session.run(2.5)
    assert pitch(stepped_session.sound[-int(0.7 * rate) :, 0], rate) == pytest.approx(
        660.0, rel=0.01
    )
    stepped_session.ok("lfo bell.f 0.9..1.1 period 1bar\nset bell2.f A3 C4 E4 every 1")
    stepped_session.run(2.5)
    stepped_session.ok("lfo bell.f off\nset sky.f x1@0 smooth x2@2")
    stepped_session.run(2.5)
    stepped_session.ok("undo")
    stepped_session.run(1.0)
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_set_pitch_of_instrument_edits_transpose_and_bank(stepped_session):
    def written_pitch(name):
        return stepped_session.session.schedule.head.piece.instruments[name].pitch

    stepped_session.ok("play from 1|1")
    stepped_session.run(0.5)
    stepped_session.ok("set bell.f C4 now")
    assert "transpose: 3st" in stepped_session.session.schedule.head.texts.text
    assert (written_pitch("bell"), written_pitch("bell2")) == (
        pytest.approx(261.6256),
        pytest.approx(261.6256),
    )
    stepped_session.run(1.0)
    assert pitch(
        stepped_session.sound[-int(0.7 * stepped_session.rate) :, 0], stepped_session.rate
    ) == pytest.approx(261.6, rel=0.01)
    stepped_session.ok("set bell.f x1.5 now")
    assert written_pitch("bell") == pytest.approx(392.4384)
    stepped_session.ok("set bell2.f A4 now")
    assert "bell2: {like: bell, f: A4}" in stepped_session.session.schedule.head.texts.text
    stepped_session.ok("set bell.f A3 now")
    assert "transpose" not in stepped_session.session.schedule.head.texts.text
    stepped_session.ok("set sky.f x2 now\nset sky.t60 x0.5 now")
    assert "f: 400Hz..1800Hz, t60: 2s" in stepped_session.session.schedule.head.texts.text
    stepped_session.run(1.0)
    stepped_session.ok("map cc 21 bell.f A3..A4")
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("set sky.f A3 over 1bar", "values of their own; write a factor, x1.5"),
        ("set sky.f A3", "values of their own; write a factor, x1.5"),
        ("set sky.f A3 C4 every 1", "values of their own; write a factor, x1.5"),
        ("map cc 3 sky.f 1Hz..2Hz", "values of their own; write a factor, x1.5"),
        ("set hard.f A4 over 1bar", "the law of its LNL n does not change while it plays"),
        ("lfo hard.f 0.9..1.1 period 1bar", "glide its modules"),
        ("set bell.f foo over 1bar", "foo"),
        ("set bell.t60 2s over 1bar", "'bell.t60' is not a parameter"),
    ],
)
def test_glides_of_pitches_without_one_value_are_refused(stepped_session, line, message):
    stepped_session.ok("play from 1|1")
    reply = stepped_session.type(line)
    assert not reply.taken
    assert message in reply.text
