"""A session as Python: every verb is a method, and each call is the line that it stands for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from one_bell import SCORE
from patience import PATIENCE
from sessions import Stepped

import ergon
from ergon.repl.language import building
from ergon.repl.language.verbs import FORMS
from ergon.repl.session.api import NotTaken, SessionProxy
from ergon.repl.session_protocol import Reply

# The example of every verb's help, as a call.
CALLS: dict[str, Callable[[SessionProxy], Reply]] = {
    "ada plays knock every 1 times 8": lambda s: s.plays("ada", "knock", every=1, times=8),
    "ada do scale 1.2, mirror": lambda s: s.do("ada", ["scale 1.2", "mirror"]),
    "knock = 0@0 smooth 7@1/8 smooth 0@1/4": lambda s: s.define(
        "knock", "0@0 smooth 7@1/8 smooth 0@1/4"
    ),
    "hear gong f": lambda s: s.hear("gong f"),
    "rest ada": lambda s: s.rest("ada"),
    "hush": lambda s: s.hush(),
    "damp 3s": lambda s: s.damp("3s"),
    "panic": lambda s: s.panic(),
    "release": lambda s: s.release(),
    "play from B": lambda s: s.play("B"),
    "stop": lambda s: s.stop(),
    "tempo 60 -> 84 over 4bar": lambda s: s.tempo("60 -> 84", over="4bar"),
    "meter 3+2+2/8": lambda s: s.meter("3+2+2/8"),
    "tap": lambda s: s.tap(),
    "nudge -10ms": lambda s: s.nudge("-10ms"),
    "quant 2bar": lambda s: s.quant("2bar"),
    "set bell.m.K x1.5 over 2bar": lambda s: s.set("bell.m.K", "x1.5", over="2bar"),
    "couple k1 k2 K=40N/m": lambda s: s.couple("k1", "k2", K="40N/m"),
    "uncouple k1 k2": lambda s: s.uncouple("k1", "k2"),
    "record remi as solo": lambda s: s.record("remi", as_="solo"),
    "record off": lambda s: s.record("off"),
    "guide remi ada K=30N/m": lambda s: s.guide("remi", "ada", K="30N/m"),
    "guide remi off": lambda s: s.guide("remi", "off"),
    "gain bell -6dB": lambda s: s.gain("bell", "-6dB"),
    "mute bell": lambda s: s.mute("bell"),
    "solo bell": lambda s: s.solo("bell"),
    "unmute bell": lambda s: s.unmute("bell"),
    "gain rain -6dB": lambda s: s.gain("rain", "-6dB"),
    "mute rain": lambda s: s.mute("rain"),
    "solo rain": lambda s: s.solo("rain"),
    "unmute rain": lambda s: s.unmute("rain"),
    "meters": lambda s: s.meters(),
    "def fill: ada plays lean times 2": lambda s: s.define_block("fill", "ada plays lean times 2"),
    "run fill": lambda s: s.run("fill"),
    "fill every 4bar": lambda s: s.every("fill", "4bar"),
    "when bar % 4 == 3 fill": lambda s: s.when("bar % 4 == 3 fill"),
    "stop fill": lambda s: s.stop("fill"),
    "undo": lambda s: s.undo(),
    "redo": lambda s: s.redo(),
    "back 3": lambda s: s.back(3),
    "history": lambda s: s.history(),
    "bell2 = bell/bell transpose 7st": lambda s: s.define("bell2", "bell/bell transpose 7st"),
    "use skins": lambda s: s.use("skins"),
    "voices": lambda s: s.voices(),
    "instruments skins": lambda s: s.instruments("skins"),
    "gestures": lambda s: s.gestures(),
    "scenes": lambda s: s.scenes(),
    "link k1 bell.m BUT K=4kN/m": lambda s: s.link("k1", "bell.m", "BUT", "K=4kN/m"),
    "mia takes k3 like k1": lambda s: s.takes("mia", "k3", like="k1"),
    "route bell 3 4 gain -6dB pan -0.3": lambda s: s.route("bell", "3 4", gain="-6dB", pan=-0.3),
    "route bell gain -6dB": lambda s: s.route("bell", gain="-6dB"),
    "route bell pan -0.3": lambda s: s.route("bell", pan=-0.3),
    "pan bell -0.3": lambda s: s.pan("bell", pan=-0.3),
    "pan bell 0.8 over 4bar": lambda s: s.pan("bell", pan=0.8, over="4bar"),
    "filter bell lowpass 2kHz": lambda s: s.filter("bell", "lowpass", "2kHz"),
    "route bell send hall -12dB": lambda s: s.route("bell", send="hall -12dB"),
    "room hall t60=2s size=12m": lambda s: s.room("hall", "t60=2s size=12m"),
    "fade bell out over 8bar": lambda s: s.fade("bell", "out", over="8bar"),
    "remove bell": lambda s: s.remove("bell"),
    "rename lean tilt": lambda s: s.rename("lean", "tilt"),
    "keep 8bar as verse-2": lambda s: s.keep("8bar", "verse-2"),
    "scene verse-2 -> refrain over 4bar": lambda s: s.scene("verse-2 -> refrain", over="4bar"),
    "save scores/duet-live.yaml": lambda s: s.save(Path("scores/duet-live.yaml")),
    "load duet.yaml": lambda s: s.load("duet.yaml"),
    "reload": lambda s: s.reload(),
    "seed 7": lambda s: s.seed(7),
    "? lean": lambda s: s.look("lean"),
    "show ada": lambda s: s.show("ada"),
    "scope ada": lambda s: s.scope("ada"),
    "scope remi on": lambda s: s.scope("remi", "on"),
    "scope off": lambda s: s.scope("off"),
    "help plays": lambda s: s.help("plays"),
    "py session.state().tempo": lambda s: s.py("session.state().tempo"),
    "quit": lambda s: s.quit(),
    "map cc 21 bell.m.K 1kN/m..9kN/m": lambda s: s.map("bell.m.K", "1kN/m..9kN/m", cc=21),
    "map cc 7 gain bell -40dB..0dB": lambda s: s.map("-40dB..0dB", cc=7, gain="bell"),
    "map cc 8 gain -40dB..0dB": lambda s: s.map("gain", "-40dB..0dB", cc=8),
    "map note C3..C5 bell.m 1mNs..20mNs": lambda s: s.map("bell.m", "1mNs..20mNs", note="C3..C5"),
    "map note C3..C5 gong curve square": lambda s: s.map("gong", note="C3..C5", curve="square"),
    "map note D2 ada knock": lambda s: s.map("ada", "knock", note="D2"),
    "map learn note gong": lambda s: s.map(learn=True, note="gong"),
    "monitor on": lambda s: s.monitor("on"),
    "monitor off": lambda s: s.monitor("off"),
    "map cc 1 tempo 60..180": lambda s: s.map(cc=1, tempo="60..180"),
    "maps": lambda s: s.maps(),
    "record audio evening.wav": lambda s: s.record("audio", file="evening.wav"),
    "record audio off": lambda s: s.record("audio", file="off"),
    "unmap cc 21": lambda s: s.unmap(cc=21),
    "unmap note C3..C5": lambda s: s.unmap(note="C3..C5"),
    "hook strikes tune transpose 3st": lambda s: s.strikes("hook", "tune transpose 3st"),
    "phrase tune 0 C4, 1/2 E4 to bell": lambda s: s.phrase("tune", "0 C4, 1/2 E4", to="bell"),
    "rain strikes bell every 1 impulse 2mNs": lambda s: s.strikes(
        "rain", "bell every 1 impulse 2mNs"
    ),
    "bell notes A3 C4 E4 euclid 5 8": lambda s: s.notes("bell", "A3 C4 E4 euclid 5 8"),
    "rain do every 4 rev, ply 2": lambda s: s.do("rain", "every 4 rev, ply 2"),
    'd1 = "bell*2 ~ bell" 2mNs': lambda s: s.define("d1", '"bell*2 ~ bell" 2mNs'),
    "set bell.m.K from tune.mid by cc 1/33 range 0.5..2": lambda s: s.set(
        "bell.m.K", from_="tune.mid", by="cc 1/33", range="0.5..2"
    ),
    "set bell.tuning edo 19": lambda s: s.set("bell.tuning", "edo 19"),
    "set bell.m.f A3 C4 E4 every 1": lambda s: s.set("bell.m.f", "A3 C4 E4 every 1"),
    "lfo bell.m.K 0.8..1.2 period 4bar": lambda s: s.lfo("bell.m.K", "0.8..1.2 period 4bar"),
    "lfo bell.m.K off": lambda s: s.lfo("bell.m.K", "off"),
}
MORE: dict[str, Callable[[SessionProxy], Reply]] = {
    "map bend tempo 60..180": lambda s: s.map(bend=True, tempo="60..180"),
    "map pressure C4 gain 0dB": lambda s: s.map("gain", "0dB", pressure="C4"),
    "map note C3..C5 gong": lambda s: s.map("gong", note="C3..C5"),
    "ada plays knock every 1/2 touch free do scale 0.8, mirror now": lambda s: s.plays(
        "ada", "knock", do=("scale 0.8", "mirror"), every="1/2", touch="free", now=True
    ),
    "ada plays solo from 4 at 9|1": lambda s: s.plays("ada", "solo", from_=4, at="9|1"),
    "ada plays knock loop in 2": lambda s: s.plays("ada", "knock", loop=True, times=None, in_=2),
    "gain -6dB": lambda s: s.gain("-6dB"),
    "play": lambda s: s.play(),
    "unmute": lambda s: s.unmute(),
    "tempo 72": lambda s: s.tempo(72),
    "tempo 72.5 now": lambda s: s.tempo(bpm=72.5, now=True),
    "couple k1 k2 K=40N/m Z=1Ns/m": lambda s: s.couple("k1", "k2", "40N/m", "1Ns/m"),
    'save "my score.yaml"': lambda s: s.save("my score.yaml"),
}


class StoringFace:
    """A face that keeps what it was told."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.closed = False

    def submit(self, text: str) -> Reply:
        self.lines.append(text)
        if text == "adda":
            return Reply(False, "unknown verb 'adda'", "ada plays knock")
        return Reply(True, "ok", leaves=text == "quit")

    def close(self) -> None:
        self.closed = True


def test_calls_cover_every_form_of_verbs():
    assert set(CALLS) == {form.example for form in FORMS}


@pytest.mark.parametrize("wanted", [*CALLS, *MORE])
def test_method_call_submits_its_line(wanted: str):
    face = StoringFace()
    reply = (CALLS | MORE)[wanted](SessionProxy(face))
    assert face.lines == [wanted]
    assert reply.taken
    assert face.closed == (wanted == "quit")


def test_refused_line_raises_not_taken():
    face = StoringFace()
    with pytest.raises(NotTaken, match=r"unknown verb 'adda'; try: ada plays knock") as refused:
        SessionProxy(face)("adda")
    assert refused.value.reply == Reply(False, "unknown verb 'adda'", "ada plays knock")
    assert SessionProxy(face)("any line").text == "ok"


@pytest.mark.parametrize(
    "wrong",
    [
        lambda s: s.tempo(),
        lambda s: s.tempo(60, "2bar", 3),
        lambda s: s.hush("ada"),
        lambda s: s.rest("ada", fast=True),
        lambda s: s.panic(now=True),
        lambda s: s.rest("ada", now=True, beat="3|1"),
        lambda s: s.record("on"),
    ],
)
def test_invalid_call_raises_type_error(wrong: Callable[[SessionProxy], Reply]):
    face = StoringFace()
    with pytest.raises(TypeError, match="write it as "):
        wrong(SessionProxy(face))
    assert face.lines == []


def test_argument_with_newline_raises_value_error():
    face = StoringFace()
    with pytest.raises(ValueError, match="one line"):
        SessionProxy(face).py("1\nquit")
    assert face.lines == []


def test_names_can_be_completed_and_explained():
    session = SessionProxy(StoringFace())
    assert {"plays", "define", "look", "hush", "state"} <= set(dir(session))
    assert "ada plays knock every 1 times 8" in (session.plays.__doc__ or "")
    assert not hasattr(session, "plyas")
    assert set(building.VERB_BY_FUNCTION.values()) == {form.verb for form in FORMS}


def test_calls_on_stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    with SessionProxy(stepped.session) as session:
        session.play()
        stepped.run(0.2)
        assert session.plays("ada", "lean", every=2, now=True).text.startswith("ok 1|")
        session.tempo(72)
        session.define("knock", "0@0 smooth 5@1/8 smooth 0@1/2")
        session.set("bell.m.K", "x1.5", over="2bar")
        with pytest.raises(NotTaken):
            session.plays("ada", "nothing")
        stepped.run(2.5)
        assert session.state.tempo == 72
        assert dict(session.state.playing) == {"ada": "lean"}
        assert "knock: 0@0 smooth 5@1/8" in stepped.session.schedule.head.texts.text


def test_open_session_options_and_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    Path("score.yaml").write_text(SCORE)
    Path("bad.yaml").write_text(SCORE.replace("400g", "400h"))
    options = ergon.SessionOptions(audio="null", gain="0dB", journal="mine.jsonl")
    with ergon.open_session("score.yaml", options) as session:
        assert session.play().text == "ok from 1|1"
        with pytest.raises(ergon.NotTaken):
            session("adda")
    assert '"adda"' in Path("mine.jsonl").read_text()
    null = ergon.SessionOptions(audio="null")
    with ergon.open_session(None, replace(null, resume="mine.jsonl")) as session:
        assert session.state.tempo == 120
    with pytest.raises(ergon.ScoreError, match=r"^bad\.yaml:8:14: error\[E203\] M of key 'k1'"):
        ergon.open_session("bad.yaml", null)
    with pytest.raises(ergon.DeviceError):
        ergon.open_session("score.yaml", replace(options, audio="nonsense"))
    with pytest.raises(ergon.OptionError, match="socket: no session is served"):
        ergon.open_session(None, ergon.SessionOptions(socket=str(tmp_path / "s")))


def test_notebook_page_example_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The example of docs/notebook.md, on a piece that stands still: no line comes too late."""
    page = (Path(__file__).parents[2] / "docs" / "notebook.md").read_text(encoding="utf-8")
    code = page.partition("```python\n")[2].partition("```")[0]

    def stepped(path: str, options: ergon.SessionOptions) -> ergon.Session:
        assert (path, options) == ("score.yaml", ergon.SessionOptions(audio="null"))
        return ergon.Session(Stepped(SCORE, tmp_path).session)

    monkeypatch.setattr(ergon, "open_session", stepped)
    exec(code, {})
    output = capsys.readouterr().out
    assert "kock" in output
    assert "try: ada plays knock" in output
    assert output.count("knock = 0@0") == 4


def test_session_closed_at_interpreter_exit(tmp_path: Path):
    (tmp_path / "score.yaml").write_text(SCORE)
    code = (
        "import ergon; options = ergon.SessionOptions(audio='null', gain='0dB'); "
        "ergon.open_session('score.yaml', options).play()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    assert '"event": "end"' in (tmp_path / "session.jsonl").read_text()
