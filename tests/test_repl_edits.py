import difflib
import random
from pathlib import Path

import pytest

from ergon.repl.session.edits import keeping, keys, matter, names, parts, times
from ergon.repl.session.texts import Texts
from ergon.scores.text.edit import EditError

ROOT = Path(__file__).parents[1]
BUNDLED = sorted(ROOT.glob("scores/library/*.yaml"))
TEMPLATES = sorted(ROOT.glob("cli/templates/*/score.yaml"))
SCORES = [str(path) for path in BUNDLED + TEMPLATES]
DUET, TEMPO, TWO = (
    str(ROOT / "scores" / "library" / name) for name in ("duet.yaml", "tempo.yaml", "two-keys.yaml")
)


def opened(path, text=None):
    texts = Texts.read(path) if text is None else Texts(path, text)
    return texts, piece_of(texts)


def piece_of(texts):
    loaded = texts.load()
    assert loaded.piece is not None, [str(d.message) for d in loaded.diagnostics]
    return loaded.piece


def lines(before, after, file=None):
    """Lines taken away and lines added."""
    a = Path(file).read_text() if file else before.text
    b = after.overlay[file] if file else after.text
    found = list(difflib.ndiff(a.splitlines(), b.splitlines()))
    return [x[2:] for x in found if x[0] == "-"], [x[2:].strip() for x in found if x[0] == "+"]


def begun(piece, player):
    """(what, beats) of everything that a player plays, in order of time."""
    found = [
        (start, play.what, tuple(t.word for t in play.do))
        for play, starts in zip(piece.parts, piece.starts, strict=True)
        if play.player == player
        for start in (starts if starts is not None else [piece.tempo_map.resolve(play.at)])
    ]
    return sorted(found)


def same(found, wanted):
    """The same plays in the same order, at the same beats."""
    assert [rest for _, *rest in found] == [rest for _, *rest in wanted]
    assert [beat for beat, *_ in found] == pytest.approx([beat for beat, *_ in wanted])


# --- parts ---------------------------------------------------------------------------------------


def test_a_line_goes_on_from_its_beat():
    texts, piece = opened(DUET)
    after = parts.play(texts, piece, "ada", 8.0, "roll every 2")
    assert lines(texts, after) == (
        [
            "    - {at: A, play: knock, every: 1, times: 16}",
            "    - {at: B, play: lean, do: [mirror], times: 4}",
            "    - {at: C, play: soft, every: 1, times: 16, do: [jitter 4ms 0.2mm]}",
        ],
        [
            "- {at: A, play: knock, every: 1, times: 16, until: 3|1}",
            "- {at: 3|1, play: roll, every: 2, until: 999|1}",
        ],
    )
    new = begun(piece_of(after), "ada")
    assert [x for x in new if x[0] < 8] == [x for x in begun(piece, "ada") if x[0] < 8]
    assert [x for x in new if x[0] >= 8][:3] == [(8 + 2 * i, "roll", ()) for i in range(3)]


def test_a_table_stays_a_table():
    texts, piece = opened(DUET)
    after = parts.play(texts, piece, "remi", 8.0, "lean every 4 times 2 layer do scale 0.5, mirror")
    assert lines(texts, after)[1] == [
        "A      lean every 8 times 2 until 3|1",
        "3|1    lean every 4 times 2 layer do scale 0.5, mirror",
    ]
    again = parts.play(after, piece_of(after), "remi", 10.0, "lean")
    assert lines(after, again)[1] == [
        "3|1    lean every 4 times 2 layer do scale 0.5, mirror until 3|3",
        "3|3    lean",
    ]


@pytest.mark.parametrize(
    ("words", "written"),
    [
        ("tap", "{at: 3|1.5, play: tap}"),
        ("tap every 1/2 times 3", "{at: 3|1.5, play: tap, every: 1/2, times: 3}"),
        ("tap every 1 until C", "{at: 3|1.5, play: tap, every: 1, until: C}"),
        ("tap layer grain 5ms", "{at: 3|1.5, play: tap, layer: true, grain: 5ms}"),
        ("tap do jitter 4ms 0.2mm", "{at: 3|1.5, play: tap, do: [jitter 4ms 0.2mm]}"),
    ],
)
def test_words_become_fields(words, written):
    texts, piece = opened(TWO)
    after = parts.play(texts, piece, "ada", 8.5, words)
    assert lines(texts, after)[1][-1] == f"- {written}"
    piece_of(after)


def test_a_player_without_a_part_gets_one():
    text = Path(TWO).read_text().split("parts:")[0] + "parts:\n  ada:\n"
    texts, piece = opened(TWO, text)
    after = parts.play(texts, piece, "remi", 0.0, "tap")
    assert lines(texts, after) == ([], ["remi:", "- {at: 1|1, play: tap}"])
    texts, piece = opened(TWO, text.replace("parts:\n  ada:\n", ""))
    after = parts.play(texts, piece, "remi", 0.0, "tap")
    assert lines(texts, after) == ([], ["parts:", "remi:", "- {at: 1|1, play: tap}", ""])


@pytest.mark.parametrize("words", ["", "every 1", "tap evry 1", "tap do swing"])
def test_words_that_say_nothing_are_refused(words):
    texts, piece = opened(TWO)
    with pytest.raises(EditError):
        parts.play(texts, piece, "ada", 8.0, words)


def test_what_plays_goes_on_otherwise_and_in_time():
    texts, piece = opened(TWO)
    old = begun(piece, "ada")
    after = parts.transform(texts, piece, "ada", 9.0, "mirror, scale 1.2")
    new = begun(piece_of(after), "ada")
    assert [start for start, *_ in new] == [start for start, *_ in old]
    for (start, what, do), (_, was, done) in zip(new, old, strict=True):
        # Of the entry that sounds, all that is left; what was to come later is as it was.
        more = ("mirror", "scale") if 9.0 <= start < 16.0 else ()
        assert (what, do) == (was, (*done, *more))
    twice = parts.transform(after, piece_of(after), "ada", 10.0, "reverse")
    assert ("mirror", "scale", "reverse") in {do[-3:] for _, _, do in begun(piece_of(twice), "ada")}


def test_a_gesture_under_way_begins_again_transformed():
    texts, piece = opened(DUET)
    texts = parts.play(texts, piece, "ada", 4.0, "lean")
    after = parts.transform(texts, piece_of(texts), "ada", 6.0, "mirror")
    assert begun(piece_of(after), "ada")[-2:] == [(4.0, "lean", ()), (6.0, "lean", ("mirror",))]
    with pytest.raises(EditError, match="plays nothing"):
        parts.transform(texts, piece_of(texts), "ada", 9.0, "mirror")


@pytest.mark.parametrize(("score", "what"), [(DUET, "lean"), (TWO, "tap")])
def test_what_begins_just_there_begins_transformed(score, what):
    texts, piece = opened(score)
    texts = parts.play(texts, piece, "ada", 8.0, f"{what} every 2 times 3 do mirror")
    once = parts.transform(texts, piece_of(texts), "ada", 8.0, "scale 0.5")
    twice = parts.transform(once, piece_of(once), "ada", 8.0, "reverse")
    before, after = begun(piece_of(texts), "ada"), begun(piece_of(twice), "ada")
    assert [where for where in after if where[0] < 8.0] == [b for b in before if b[0] < 8.0]
    do = ("mirror", "scale", "reverse")
    assert [where for where in after if where[0] >= 8.0] == [
        (8.0, what, do),
        (10.0, what, do),
        (12.0, what, do),
    ]


@pytest.mark.parametrize("path", SCORES)
@pytest.mark.parametrize("at", [0.0, 6.5, 17.0])
def test_rest_leaves_what_has_begun(path, at):
    texts, piece = opened(path)
    after = parts.rest(texts, piece, None, at)
    for player in piece.players:
        assert begun(piece_of(after), player) == [x for x in begun(piece, player) if x[0] < at]


@pytest.mark.parametrize("at", [0.0, 9.0, 17.0, 40.0])
def test_after_hush_no_ergon_begins(at):
    for path in SCORES:
        texts, piece = opened(path)
        silent = piece_of(parts.hush(texts, piece, at))
        tempo = silent.tempo_map
        for strikes in silent.strikes:
            assert tempo.resolve(strikes.at) < at
            ends = [tempo.resolve(strikes.until)] if strikes.until else []
            if strikes.span:
                ends.append(tempo.after(tempo.resolve(strikes.at), strikes.span))
            if strikes.every and strikes.times:
                ends.append(
                    tempo.after(tempo.resolve(strikes.at), strikes.every.times(strikes.times - 1))
                )
            assert min(ends) <= at


def test_what_is_saved_has_an_end():
    texts, piece = opened(TWO)
    texts = parts.play(texts, piece, "ada", 8.0, "tap every 1")
    texts = parts.play(texts, piece_of(texts), "remi", 30.0, "tap every 1")
    after = parts.finish(texts, piece_of(texts), 20.0)
    assert "999|1" not in after.text
    assert begun(piece_of(after), "ada")[-1][0] == 19.0
    assert begun(piece_of(after), "remi")[-1][0] == 30.0


def test_a_long_session_has_no_last_bar():
    texts, piece = opened(TWO)
    at = 950 * 4.0
    after = piece_of(parts.play(texts, piece, "ada", at, "tap every 4"))
    assert begun(after, "ada")[-1][0] > at + 4000


def test_an_entry_behind_an_alias_is_written_out():
    text = (
        Path(TWO)
        .read_text()
        .replace(
            "    - {at: B, play: tap, every: 3/4, times: 10, do: [scale 0.8]}\n",
            "    - &b {at: B, play: tap, every: 3/4, times: 10, do: [scale 0.8]}\n",
        )
    )
    text = text.replace("  remi:\n", "  remi:\n    - *b\n")
    texts, piece = opened(TWO, text)
    after = parts.rest(texts, piece, "remi", 9.0)
    assert (
        "    - {at: B, play: tap, every: 3/4, times: 10, until: 3|2, do: [scale 0.8]}" in after.text
    )
    assert begun(piece_of(after), "ada") == begun(piece, "ada")


# --- time ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", SCORES)
@pytest.mark.parametrize("at", [0.0, 3.0, 12.0, 22.0, 60.0])
@pytest.mark.parametrize(("bpm", "over"), [("72", None), ("60 -> 96", "8")])
def test_the_tempo_holds_from_its_beat(path, at, bpm, over):
    texts, piece = opened(path)
    after = piece_of(times.change(texts, piece, at, bpm, over)).tempo_map
    for k in range(20):
        beats = at * k / 20
        assert after.seconds(beats) == pytest.approx(piece.tempo_map.seconds(beats), abs=1e-9)
        assert after.bar_beat(at + k) == piece.tempo_map.bar_beat(at + k)
    assert after.bpm(at) == float(bpm.split()[0])
    assert after.bpm(at + 1000) == float(bpm.split()[-1])


def test_a_ramp_under_way_ends_where_it_is():
    texts, piece = opened(DUET)
    after = times.change(texts, piece, 36.0, "72")
    assert lines(texts, after)[1] == [
        "- {at: 9|1, bpm: 60 -> 69, over: 4}   # accelerando",
        "- {at: 10|1, bpm: 72}",
    ]


@pytest.mark.parametrize(
    "tempo",
    [
        "tempo: {at: 1|1, bpm: 60}\n",
        "tempo: {at: 3|1, meter: 3/4}\n",
        "tempo:\n  at: 3|1\n  bpm: 60\n",
        "tempo: []\n",
        "",
    ],
)
def test_a_tempo_beside_a_lone_one(tempo):
    head, tail = Path(TWO).read_text().split("tempo:\n")
    texts, piece = opened(TWO, head + tempo + tail[tail.index("marks:") :])
    after = piece_of(times.change(texts, piece, 4.0, "90"))
    assert after.tempo_map.bpm(4.0) == 90.0
    assert after.tempo_map.bar_beat(20.0) == piece.tempo_map.bar_beat(20.0)


def test_a_mark_is_where_it_was_set():
    texts, piece = opened(DUET)
    after = piece_of(times.mark(texts, piece, "verse-2", 13.25))
    assert {m.name: after.tempo_map.resolve(m.at) for m in after.marks}["verse-2"] == 13.25


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["knock", "roll", "lean", "soft", "new"])
def test_a_gesture_is_what_was_said(name):
    texts, piece = opened(DUET)
    after = names.define(texts, name, "0@0 smooth 7@1/8 0@1/4")
    found = piece_of(after).gestures[name]
    assert [point.x for point in found.points] == [0.0, 0.007, 0.0]
    if name in piece.gestures:
        assert found.do == piece.gestures[name].do
        assert found.manner == piece.gestures[name].manner


def test_a_gesture_of_a_file_is_redefined_there():
    texts, _ = opened(TEMPO)
    after = names.define(texts, "tap", "0@0 smooth 7@1/8 0@1/4")
    file = str(ROOT / "scores" / "library" / "gestures" / "common.yaml")
    assert after.text == texts.text
    assert lines(texts, after, file)[1] == [
        "tap: 0@0 smooth 7@1/8 0@1/4     # throws a hammer over a gap of 7 mm"
    ]
    assert piece_of(after).gestures["tap"].points[1].x == 0.007
    prefixed = texts.text.replace(", gestures/common.yaml]", "]").replace(
        "use: [instruments/string.yaml]",
        "use: {s: instruments/string.yaml, c: gestures/common.yaml}",
    )
    texts = Texts(TEMPO, prefixed.replace("tap,", "c.tap,").replace(" tap", " c.tap"))
    after = names.define(texts, "c.tap", "0@0 smooth 7@1/8 0@1/4")
    assert list(after.overlay) == [file]


def test_a_take_and_a_seed():
    texts, _ = opened(DUET)
    after = piece_of(names.seed(names.take(texts, "solo", "takes/hand-draw-1.csv", "x"), 7))
    assert (after.takes["solo"].channel, after.seed) == ("x", 7)


# --- keys ----------------------------------------------------------------------------------------


def acting(piece, at):
    found = []
    for c in piece.duet:
        until = piece.tempo_map.resolve(c.until) if c.until else float("inf")
        if piece.tempo_map.resolve(c.at) <= at < until:
            found.append(c.link.fields["K"])
    return found


@pytest.mark.parametrize("at", [8.0, 32.0, 40.0])
def test_a_coupling_takes_the_place_of_another(at):
    texts, piece = opened(DUET)
    after = keys.couple(texts, piece, at, "k2", "k1", "90N/m", "1Ns/m")
    new = piece_of(after)
    for beat in (0.0, 7.0, 31.0, 39.0, 41.0, 100.0):
        assert acting(new, beat) == ([90.0] if beat >= at else acting(piece, beat))
    assert "duet:                                      # the two keys" in after.text
    free = piece_of(keys.uncouple(after, new, at + 8, "k1", "k2"))
    assert acting(free, at + 9) == []
    assert acting(free, at + 7) == [90.0]


def test_keys_that_nothing_joins_cannot_part():
    texts, piece = opened(DUET)
    texts = keys.uncouple(texts, piece, 8.0, "k1", "k2")
    with pytest.raises(EditError, match="not coupled"):
        keys.uncouple(texts, piece_of(texts), 8.0, "k1", "k2")


# --- matter --------------------------------------------------------------------------------------


def value(piece, target):
    part, _, name = target.rpartition(".")
    owner, _, module = part.partition(".")
    made = piece.keys.get(owner) or piece.instruments[owner]
    return {m.name: m for m in made.modules}[module].fields[name]


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
def test_a_value_is_multiplied_where_it_is_written(path, target):
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


def test_what_another_begins_with_stays():
    texts, piece = opened(TEMPO)
    after = piece_of(matter.set_value(texts, piece, "high.hammer.M", "9g"))
    assert value(after, "high.hammer.M") == 0.009
    assert value(after, "low.hammer.M") == value(piece, "low.hammer.M") == 0.006


@pytest.mark.parametrize(("target", "other"), [("bell.m.K", "Z"), ("bell.m.Z", "K")])
def test_stiffness_takes_the_place_of_a_pitch(target, other):
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


def test_a_measured_value_is_what_is_multiplied():
    texts, piece = opened(DUET)
    measured = value(piece, "k2.M")
    after = piece_of(matter.set_value(texts, piece, "k2.M", "x2"))
    assert value(after, "k2.M") == pytest.approx(2 * measured)


def test_under_ca_numbers_stay_numbers():
    text = (
        "ergon: 1\ninstruments:\n  bell:\n    units: ca\n    at: 44100Hz\n    modules:\n"
        "      m: {CEL: {M: 1, K: 0.001, Z: 1e-5}}\n    out: {SOX: m}\n"
    )
    texts, piece = opened("s.yaml", text)
    after = matter.set_value(texts, piece, "bell.m.K", "x2")
    assert "K: 0.002," in after.text
    assert value(piece_of(after), "bell.m.K") == pytest.approx(0.002)


def test_a_changed_file_that_ships_is_saved_beside_the_score(tmp_path):
    # The bank is used by the gong's file, which ships too and stays where it is.
    texts, piece = opened(DUET)
    texts = texts.changed(texts.text.replace("layout: layouts/dome24.yaml", "layout: dome.yaml"))
    text = (ROOT / "scores" / "library" / "layouts" / "dome24.yaml").read_text()
    (tmp_path / "dome.yaml").write_text(text)
    texts = matter.set_value(texts, piece, "sky.t60", "x2")
    texts = names.define(texts, "tap", "0@0 smooth 7@1/8 0@1/4")
    for path, text in texts.files(tmp_path).items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    (tmp_path / "live.yaml").write_text(texts.text)
    assert sorted(path.name for path in tmp_path.rglob("*.yaml")) == [
        "bank.yaml",
        "common.yaml",
        "dome.yaml",
        "live.yaml",
    ]
    saved = Texts.read(tmp_path / "live.yaml")
    assert value(piece_of(saved), "sky.t60") == (1.0, 16.0)


@pytest.mark.parametrize(
    "target", ["bell.K", "bell.q.K", "bell.m.Q", "nix", "k1", "nix.K", "k1.m.K", "bell.m.K.x", ""]
)
def test_what_is_not_there_cannot_be_set(target):
    texts, piece = opened(DUET)
    with pytest.raises(EditError):
        matter.set_value(texts, piece, target, "1")


def test_gains_are_those_of_the_routes():
    texts, piece = opened(TWO)
    after = piece_of(matter.gain(texts, "tamtam", "-20dB"))
    gains = {(route.part, route.out): route.gain for route in after.mix.routes}
    assert gains["tamtam", "left"] == gains["tamtam", "right"] == pytest.approx(0.1)
    assert gains["bell", None] != pytest.approx(0.1)
    master = piece_of(matter.gain(texts, None, "-20dB")).mix.master
    assert master.gain == pytest.approx(0.1)
    assert len(piece.mix.routes) == len(after.mix.routes)
    with pytest.raises(EditError, match="no route"):
        matter.gain(texts, "nix", "-20dB")


# --- keeping -------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", SCORES)
@pytest.mark.parametrize(("start", "stop"), [(0.0, 16.0), (8.0, 16.0), (12.0, 44.0)])
def test_bars_are_kept_as_they_were(path, start, stop):
    texts, piece = opened(path)
    said = keeping.keep(texts, piece, "verse-2", start, stop)
    kept = piece_of(said)
    tempo = piece.tempo_map
    for player in piece.players:
        inside = [(b - start, *rest) for b, *rest in begun(piece, player) if start <= b < stop]
        same(begun(kept, player), inside)
    for beat in range(int(stop - start)):
        seconds = tempo.seconds(start + beat) - tempo.seconds(start)
        assert kept.tempo_map.seconds(beat) == pytest.approx(seconds, abs=1e-9)
        assert kept.tempo_map.bar_beat(beat)[1] == tempo.bar_beat(start + beat)[1]
    back = piece_of(keeping.bring(texts, piece, kept, said, 100.0))
    for player in piece.players:
        again = [(b - 100.0, *rest) for b, *rest in begun(back, player) if b >= 100.0]
        same(again, begun(kept, player))


def test_nothing_cannot_be_kept():
    texts, piece = opened(TWO)
    with pytest.raises(EditError, match="nothing begins"):
        keeping.keep(texts, piece, "x", 400.0, 416.0)


# --- all of them ---------------------------------------------------------------------------------


def some_line(choice, texts, piece, at):
    """One edit of any kind."""
    player = choice([*piece.players, None])
    played = [*piece.gestures, *piece.takes]
    name = choice([*played, "fresh"])
    verbs = ["tempo", "mark", "seed", "rest", "hush", "set", "define", "finish"]
    if player is not None:
        verbs += 4 * ["play"] + 2 * ["transform"]
    if len(piece.keys) > 1:
        verbs += ["couple", "uncouple"]
    owner = choice([*piece.keys.values(), *piece.instruments.values()])
    module = choice(owner.modules)
    target = ".".join(filter(None, (owner.name, module.name, choice("MKf"))))
    words = choice(played) + choice(["", " every 1", " every 3/2 times 4", " layer do mirror"])
    tempo = choice([("72",), ("60 -> 90", "2bar")])
    pair = [*piece.keys][:2]
    edits = {
        "play": lambda: parts.play(texts, piece, player, at, words),
        "transform": lambda: parts.transform(texts, piece, player, at, "scale 0.9, mirror"),
        "define": lambda: names.define(texts, name, "0@0 smooth 5@60ms 0@120ms"),
        "set": lambda: matter.set_value(texts, piece, target, "x1.1"),
        "tempo": lambda: times.change(texts, piece, at, *tempo),
        "mark": lambda: times.mark(texts, piece, name, at),
        "seed": lambda: names.seed(texts, 5),
        "rest": lambda: parts.rest(texts, piece, player, at),
        "hush": lambda: parts.hush(texts, piece, at),
        "finish": lambda: parts.finish(texts, piece, at),
        "couple": lambda: keys.couple(texts, piece, at, *pair, "90N/m"),
        "uncouple": lambda: keys.uncouple(texts, piece, at, *pair),
    }
    verb = choice(verbs)
    return verb, edits[verb]()


# A calibrated key has no f of its own, a take no gesture's name: refused by the score, and said.
REFUSED = {"E111", "E303"}


@pytest.mark.parametrize("path", [path for path in SCORES if "rain" not in path])
@pytest.mark.parametrize("number", range(6))
def test_a_session_of_edits_is_a_score_at_every_step(path, number):
    chance = random.Random(number)
    texts = Texts.read(path)
    is_crlf = number % 2 == 1
    if is_crlf:
        texts = texts.changed(texts.text.replace("\n", "\r\n"))
    at, taken = 0.0, 0
    for _ in range(12):
        at += chance.choice([0.0, 1.0, 2.5, 4.0, 8.0])
        piece = piece_of(texts)
        try:
            verb, after = some_line(chance.choice, texts, piece, at)
        except EditError:
            continue
        loaded = after.load()
        if loaded.piece is None:
            codes = {d.code for d in loaded.diagnostics if d.severity == "error"}
            assert codes <= REFUSED, (verb, [str(d.message) for d in loaded.diagnostics])
            continue
        for player in piece.players if verb != "mark" else ():  # what has begun has begun
            old = [x for x in begun(piece, player) if x[0] < at - 1e-9]
            assert [x for x in begun(loaded.piece, player) if x[0] < at - 1e-9] == old, verb
        assert all(("\r\n" in line) == is_crlf for line in after.text.splitlines(True)[:-1])
        texts, taken = after, taken + 1
    assert taken > 3
