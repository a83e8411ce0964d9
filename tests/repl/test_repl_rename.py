"""Keys and instruments get other names while they sound: the text changes, and no sample does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from edited import opened
from sessions import Stepped
from sweep import few

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
seed: 5
tempo: {bpm: 240}
let: {bell: 3mm}
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
  k2: {like: k1}
instruments:
  bell:
    modules:
      m: {CEL: {M: 20g, f: 220Hz, t60: 2s}}
      low: {CEL: {M: 20g, f: 80Hz, t60: 2s}}
      b: {BUT: {between: [k1, m], K: 900N/m, gap: 1mm}}
    out: {SOX: [m, low]}
  bell2: {like: bell, modules: {b: {BUT: {between: [k2, bell.m]}}}}
  m:
    modules:
      bell: {CEL: {M: 20g, f: 300Hz, t60: 1s}}
      r: {RES: {between: [bell, bell.low], K: 9N/m}}
    out: {SOX: bell}
  harp: {CEL: {M: 5g, f: C4, t60: 1s}, notes: [C4, E4, G4], out: {SOX: harp}}
gestures:
  knock: 0mm@0 smooth 6mm@60ms 0mm@160ms
phrases:
  tune:
    to: harp
    length: 1bar
    entries: [{at: 0, what: C4, impulse: 1mNs}, {at: 2, what: bell.m harp.E4}]
strikes:
  rain: {to: [bell.m, m], at: 1|1, until: 99|1, rate: 4Hz, impulse: 1mNs..2mNs}
  hook: {play: tune, at: 1|1, every: 1bar, until: 99|1}
  steps: |
    1|3  harp.G4 bell.low  2mNs
    2|3  bell.m
automation:
  - {lfo: bell.m.K, range: 0.9..1.1, period: 1bar, at: 1|1, until: 99|1}
  - {at: 1|2, set: bell2.m.f, to: A3 C4 E4, every: 1, until: 99|1, chance: 0.5}
players:
  ada: {key: k1}
  leo: {key: k2}
duet: {couple: [k1, k2], RES: {K: 5N/m}, until: 99|1}
parts:
  ada: [{at: 1|1, play: knock, every: 1, until: 99|1}]
  leo: |
    1|2    knock every 2 until 99|1
blocks:
  fill:
    - set bell.m.K x1.1 over 1bar
    - couple k1 k2 K=3N/m
mix:
  channels: 2
  route:
    - {from: bell, to: 1}
    - {from: bell2, to: 2}
    - {from: m, to: 1}
    - {from: harp, to: [2], gain: -6dB}
"""


@pytest.fixture
def stepped_session(tmp_path: Path):
    stepped = Stepped(SCORE, tmp_path)
    stepped.ok("play")
    yield stepped
    stepped.close()


def _played(folder: Path, lines: list[str]) -> np.ndarray:
    """What a session plays that is typed these lines after 0.7 s each."""
    folder.mkdir()
    player_session = Stepped(SCORE, folder)
    player_session.ok("play")
    for line in lines:
        player_session.run(0.7)
        if line:
            player_session.ok(line)
    player_session.run(1.5)
    player_session.close()
    assert np.array_equal(player_session.again(), player_session.sound)
    return player_session.sound


@pytest.fixture(scope="module")
def without(tmp_path_factory):
    """What is played where nothing is renamed."""
    folder = tmp_path_factory.mktemp("without") / "b"
    return _played(folder, ["", "ada plays knock every 1/2", "undo", "", ""])


@pytest.mark.parametrize(
    "line",
    few(
        ["rename bell chime", "rename k1 pad", "rename k2 pad", "rename m b", "rename harp lyre"],
        ["rename k1 pad"],
    ),
)
def test_rename_and_undo_change_no_sample(tmp_path, without, line):
    lines = [line, "ada plays knock every 1/2", "undo", "undo", "redo"]
    assert np.array_equal(_played(tmp_path / "a", lines), without)


def test_rename_changes_every_reference(stepped_session):
    stepped_session.run(0.5)
    stepped_session.ok("gain bell -3dB now\nmute harp now\nmap cc 21 bell.m.K 1kN/m..9kN/m")
    stepped_session.ok("map note C3 bell.low 1mNs..2mNs")
    stepped_session.run(1.5)
    for line in ("rename bell chime", "rename k1 pad", "rename harp lyre", "rename m low2"):
        stepped_session.ok(f"{line} now")
        stepped_session.run(0.1)
    head = stepped_session.session.schedule.head
    text = head.texts.text
    for new, old in (("chime", "bell"), ("pad", "k1"), ("lyre", "harp")):
        text = text.replace(new, old)
    message = SCORE.replace("\n  m:\n", "\n  low2:\n").replace("bell.m, m]", "bell.m, low2]")
    assert text == message.replace("from: m,", "from: low2,")
    assert "let: {bell: 3mm}" in head.texts.text
    assert "      bell: {CEL" in head.texts.text  # a module of its own
    assert head.faders.gains == {"chime": pytest.approx(10 ** (-3 / 20))}
    assert head.faders.muted == {"lyre.C4", "lyre.E4", "lyre.G4"}
    assert [own.target for own in head.maps.values()] == ["chime.m.K", "chime.low"]
    assert head.piece.blocks["fill"] == ("set chime.m.K x1.1 over 1bar", "couple pad k2 K=3N/m")
    stepped_session.ok("fill now")
    stepped_session.ok("unmute lyre\nchime3 = chime transpose 7st\nset chime.m.f B3 over 1bar now")
    stepped_session.run(1.5)
    stepped_session.ok("keep 1bar as verse\nsave typed")
    assert opened(str(stepped_session.journal.with_name("typed.yaml")))[1].instruments.keys() >= {
        "chime",
        "low2",
    }
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_rename_with_new_instrument_of_old_name(stepped_session):
    stepped_session.run(0.6)
    stepped_session.ok("rename bell chime now\nbell = bell/bell\nroute bell 2")
    stepped_session.run(1.0)
    assert stepped_session.session.schedule.running.version.sounds_as.names == {"chime": "bell"}
    assert [*stepped_session.session.schedule.running.version.sounding.instruments][-1] == "bell-2"
    stepped_session.ok("rename chime gong now")
    stepped_session.ok("gain gong -6dB now")
    stepped_session.run(1.0)
    stepped_session.ok("rename bell chime")
    stepped_session.run(1.5)
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_rename_in_resumed_session(stepped_session):
    stepped_session.run(0.6)
    stepped_session.ok("rename bell chime\nrename k1 pad\nada plays knock every 1/2")
    stepped_session.run(1.5)
    stepped_session.close()
    again = Stepped.resumed(stepped_session.journal)
    again.ok("play")
    again.run(1.2)
    again.ok("undo")
    again.run(1.0)
    assert "chime" not in again.session.schedule.head.texts.text
    again.close()
    assert np.array_equal(again.again(), again.sound)
    third = Stepped.resumed(again.journal)
    third.ok("play")
    third.ok("redo")
    third.run(1.0)
    third.close()
    assert np.array_equal(third.again(), third.sound)


def _edited(stepped_session, *changes):
    path = stepped_session.journal.with_name("score.yaml")
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)


def test_reload_after_rename_with_edited_file(stepped_session):
    stepped_session.run(0.6)
    for line in ("rename bell chime", "rename k1 pad", "rename knock tap", "set chime.low.t60 1s"):
        stepped_session.ok(f"{line} now")
        stepped_session.run(0.1)
    _edited(
        stepped_session,
        ("f: 220Hz", "f: 230Hz"),
        ("6mm@60ms", "5mm@60ms"),
        ("K: 60N/m", "K: 70N/m"),
    )
    assert "was changed by" not in stepped_session.ok("reload now").text
    stepped_session.run(0.5)
    head = stepped_session.session.schedule.head
    assert "chime" in head.piece.instruments
    assert "bell" not in head.piece.instruments
    text = {m.name: m.fields for m in head.piece.instruments["chime"].modules}
    assert (text["m"]["f"], text["low"]["t60"]) == (230.0, 1.0)
    assert head.piece.keys["pad"].modules[0].fields["K"] == 70.0
    assert "tap: 0mm@0 smooth 5mm@60ms 0mm@160ms" in head.texts.text
    _edited(stepped_session, ("f: 230Hz", "f: 240Hz"))
    stepped_session.ok("reload now")
    stepped_session.run(0.5)
    stepped_session.ok("undo now")
    stepped_session.run(0.5)
    stepped_session.close()
    assert np.array_equal(stepped_session.again(), stepped_session.sound)


def test_reload_after_rename_remove_and_resume(
    stepped_session,
):
    stepped_session.run(0.6)
    stepped_session.ok("rename bell chime now")
    stepped_session.ok("remove fill now")
    stepped_session.run(0.6)
    stepped_session.close()
    _edited(stepped_session, ("6mm@60ms", "5mm@60ms"))
    again = Stepped.resumed(stepped_session.journal)
    again.ok("play")
    again.run(0.3)
    assert "was changed by" not in again.ok("reload now").text
    again.run(0.5)
    head = again.session.schedule.head
    assert "chime" in head.piece.instruments
    assert "bell" not in head.piece.instruments
    assert not head.piece.blocks
    assert "5mm@60ms" in head.texts.text
    again.close()
    assert np.array_equal(again.again(), again.sound)
