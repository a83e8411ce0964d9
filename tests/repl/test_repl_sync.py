"""`sync d1`: a line that waits until another voice begins again."""

from contextlib import closing

import numpy as np
import pytest
from sessions import Stepped

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 240}]                    # a bar is a second
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  low:
    modules: {m: {CEL: {M: 5g, f: 90Hz, t60: 50ms}}}
    play: {strike: {at: m, impulse: 1mNs..9mNs}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}
players: {ada: {key: k1}}
parts: {ada: []}
mix: {route: [{from: low, to: 1}]}
"""


@pytest.fixture
def session(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        yield session


@pytest.mark.parametrize(
    ("line", "beats"),
    [
        ('d1 = "low*2 ~" cycle 3', [7.0, 10.0, 13.0]),  # from beat 4 on
        ("d1 strikes low every 5/2", [6.5, 9.0, 11.5]),
        ("d1 strikes low euclid 3 8 every 1/2 times 9", [8.0, 12.0]),
        ("d1 strikes tune every 3 times 9", [7.0, 10.0, 13.0]),
        ("ada plays knock every 3 times 9", [7.0, 10.0, 13.0]),
        ("ada plays knock ~ knock every 1 times 30", [7.0, 10.0, 13.0]),
    ],
)
def test_sync_with_next_beginning(session, line, beats):
    session.ok("phrase tune 0 low.m 2mNs, 1 low.m length 3")
    session.ok("play")
    session.run(0.3)
    session.ok(line)  # on beat 4
    session.run(1.0)
    name = line.split()[0]
    for beat in beats:
        now = session.session.schedule.beat_now()
        assert now < beat
        place = session.ok(f"set low.m.M {5 + beat / 10:g}g sync {name}").text.removeprefix("ok ")
        bar, into = place.split("|")
        assert (int(bar) - 1) * 4 + float(into) - 1 == pytest.approx(beat)
        session.run((beat - now) / 4 + 0.1)
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_sync_with_rhythm(session):
    session.ok("play")
    session.run(0.3)
    session.ok('d1 = "low*2" cycle 3/2 now')
    session.ok('d2 = "low" cycle 3 sync d1')
    first, second = session.session.schedule.head.piece.strikes
    tempo = session.session.schedule.head.piece.tempo_map
    gap = tempo.resolve(second.at) - tempo.resolve(first.at)
    assert gap == pytest.approx(1.5)
    session.run(3.0)
    session.ok("d2 do rev sync d1")
    session.run(2.0)
    session.close()
    assert np.array_equal(session.again(), session.sound)
    with closing(Stepped.resumed(session.journal)) as resumed:
        resumed.ok("rest d2 sync d1")


def test_transformation_of_removed_voice(session):
    session.ok("play")
    session.run(0.3)
    session.ok("d1 strikes low every 3 now")
    session.run(0.2)
    session.ok("set low.m.M 6g sync d1")
    session.ok("remove d1 now")
    session.run(2.0)
    assert "M: 6g" in session.session.schedule.running.version.texts.text
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_sync_before_play(session):
    session.ok("d1 strikes low every 3 at 2|1")
    assert session.ok("set low.m.M 6g sync d1").text == "ok 2|1"
    session.ok("play")
    session.run(0.5)
    assert "M: 5g" in session.session.schedule.running.version.texts.text
    session.run(1.0)
    assert "M: 6g" in session.session.schedule.running.version.texts.text


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("hush sync nobody", "'nobody' is not the name of strikes, or a player"),
        ("hush sync", "'sync' needs the name of strikes, or a player"),
        ("hush sync ada", "ada does not begin again after"),
        ("hush sync rain", "rain strikes by chance"),
        ("panic sync rain", "'panic' acts at once: leave out 'sync'"),
    ],
)
def test_sync_with_unknown_voice_is_refused(session, line, why):
    session.ok("rain strikes low rate 3Hz")
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text


def test_completion_after_sync(session):
    session.ok("rain strikes low rate 3Hz")
    offered = {offer.text for offer in session.session.complete("hush sync ", 10)}
    assert offered == {"rain", "ada"}
    assert "sync" in {offer.text for offer in session.session.complete("hush ", 5)}
