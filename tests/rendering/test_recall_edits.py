"""What is recalled after an edit: all that it does not reach, to the bytes of a new render."""

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep import few

import ergon
from ergon.api.options import FileOptions, RenderOptions
from ergon.api.render import Render
from ergon.api.score import read, stage_piece
from ergon.rendering import memory, resumed, stretches
from ergon.rendering.known_levels import KnownLevels
from ergon.rendering.mixed_stretches import KnownMix, MixedStretches

_HAMMER = "h: {{CEL: {{M: 3g, f: 1Hz, t60: 0.3s}}}}"
_BELL = (
    "modules: {{m: {{CEL: {{M: 2g, f: {f}Hz, t60: 0.5s}}}}, "
    + _HAMMER
    + ", b: {{BUT: {{between: [h, m], K: 9e3N/m, Z: 0.1Ns/m, gap: 0.2mm}}}}}}, out: {{SOX: m}}"
)
_PLATE = "{{shape: hex, radius: 2, M: 50g, f: {f}Hz, t60: 1s, hardening: 1e10N/m3}}"
_GONG = (
    "modules: {{p: {{PLATE: "
    + _PLATE
    + "}}, "
    + _HAMMER
    + ", b: {{BUT: {{between: [h, p.centre], K: 900N/m, gap: 0.1mm}}}}}}, out: {{SOX: p.1}}"
)
_RAIN = "BANK: {{count: 12, f: 90Hz..{f}Hz, t60: 0.2s..1s, M: 1g}}, out: {{SOX: {name}.all}}"
_FADE = "mix: {master: {fade: [{at: 0s, gain: -6dB}, {at: 1s, gain: 0dB}]}}\nrender:"
_KINDS = {"bell": _BELL, "gong": _GONG, "rain": _RAIN}
_STRUCK = {"bell": "h", "gong": "h", "rain": "all"}


@dataclass(frozen=True)
class Part:
    """An instrument: its kind, its pitch [Hz], and when it is struck [s]."""

    kind: str
    f: float
    times: tuple[float, ...]


@dataclass(frozen=True)
class Score:
    """Instruments by name, and the notes of one that has several."""

    parts: tuple[tuple[str, Part], ...] = (
        ("a", Part("bell", 440.0, (0.1, 0.9))),
        ("b", Part("gong", 700.0, (0.2,))),
        ("c", Part("rain", 900.0, (0.0, 1.0))),
    )
    notes: tuple[str, ...] = ("A4", "C5")
    unused: tuple[str, ...] = field(default=())

    def text(self) -> str:
        body = ["ergon: 1", "rates: {audio: 8kHz}", "accuracy: {error: -40dB}", "instruments:"]
        for name, part in self.parts:
            body.append(f"  {name}: {{{_KINDS[part.kind].format(f=part.f, name=name)}}}")
        body += [f"  {name}: {{{_BELL.format(f=300)}}}" for name in self.unused]
        chime = _BELL.format(f=440)
        body.append(f"  chime: {{f: A4, notes: [{', '.join(self.notes)}], {chime}}}")
        body.append("strikes:")
        for name, part in self.parts:
            for number, index in enumerate(part.times):
                impulse = "1uNs..9uNs, for: 0.5s, rate: 4Hz" if part.kind == "rain" else "2mNs"
                to = f"{name}.{_STRUCK[part.kind]}"
                body.append(f"  {name}-{number}: {{to: {to}, at: {index}s, impulse: {impulse}}}")
        body.append("  tune: {to: chime.h, at: 0.3s, notes: A4 C5, every: 1/2, impulse: 2mNs}")
        body.append("render: {tail: 0.5s, bits: float}")
        return "\n".join(body) + "\n"


def renamed(score: Score, number: int) -> Score:
    parts = list(score.parts)
    number %= len(parts)
    name, part = parts[number]
    parts[number] = (f"{name}x", part)
    return replace(score, parts=tuple(parts))


def reordered(score: Score, number: int) -> Score:
    number %= len(score.parts)
    return replace(score, parts=score.parts[number:] + score.parts[:number])


def with_unused(score: Score, number: int) -> Score:
    return replace(score, unused=(*score.unused, f"u{len(score.unused)}-{number}"))


def with_part(score: Score, number: int) -> Score:
    kind = sorted(_KINDS)[number % len(_KINDS)]
    name = f"n{number}"
    if name in dict(score.parts):
        return score
    return replace(score, parts=((name, Part(kind, 500.0 + number, (0.4,))), *score.parts))


def without_part(score: Score, number: int) -> Score:
    number %= len(score.parts)
    rest = score.parts[:number] + score.parts[number + 1 :]
    return replace(score, parts=rest) if rest else score


def retuned(score: Score, number: int) -> Score:
    parts = list(score.parts)
    number %= len(parts)
    name, part = parts[number]
    parts[number] = (name, replace(part, f=part.f + 10.0))
    return replace(score, parts=tuple(parts))


def moved(score: Score, number: int) -> Score:
    parts = list(score.parts)
    number %= len(parts)
    name, part = parts[number]
    later = (*part.times[:-1], part.times[-1] + 0.25)
    parts[number] = (name, replace(part, times=later))
    return replace(score, parts=tuple(parts))


def with_note(score: Score, number: int) -> Score:
    note = ("D4", "F4", "G4", "E5", "G5")[number % 5]
    return score if note in score.notes else replace(score, notes=(note, *score.notes))


EDITS = (renamed, reordered, with_unused, with_part, without_part, retuned, moved, with_note)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stretches of 4,096 frames, of islands of any cost, in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", 4096)
    monkeypatch.setattr(stretches, "_NS_PER_SAMPLE", 0.0)
    monkeypatch.setattr(resumed, "_WORK_SECONDS_MIN", 0.0)
    monkeypatch.setattr(memory, "_WORK_SECONDS_MIN", 0.0)
    return tmp_path / "cache" / "ergon"


def rendered(
    score: Score, patch: pytest.MonkeyPatch, *, saved: bool = True, **options: str | int
) -> Render:
    Path("a.yaml").write_text(score.text())
    patch.setenv("ERGON_CACHE", "on" if saved else "off")
    return ergon.render("a.yaml", RenderOptions(**options))  # type: ignore[arg-type]


def digest(done: Render) -> str:
    return hashlib.sha256(done.frames.tobytes()).hexdigest()


def check_edits(edits: list[tuple[int, int]], patch: pytest.MonkeyPatch) -> None:
    score = Score()
    rendered(score, patch)
    for kind, number in edits:
        score = EDITS[kind](score, number)
        scratch = rendered(score, patch, saved=False)
        assert digest(rendered(score, patch)) == digest(scratch)


def series() -> st.SearchStrategy[list[tuple[int, int]]]:
    edit = st.tuples(st.integers(0, len(EDITS) - 1), st.integers(0, 7))
    return st.lists(edit, min_size=1, max_size=4)


@settings(max_examples=4, deadline=None)
@given(series())
def test_edited_scores_recalled_equal_fresh_render(edits: list[tuple[int, int]]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        check_edits(edits, patch)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(series())
def test_edited_scores_recalled_equal_fresh_render_long(edits: list[tuple[int, int]]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        check_edits(edits, patch)


class Recalled:
    """The frames of islands that each render recalled and computed."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.all: list[resumed.ResumedSimulation] = []
        plain = resumed.ResumedSimulation.__init__

        def init(simulation: resumed.ResumedSimulation, *of: object) -> None:
            plain(simulation, *of)  # type: ignore[arg-type]
            self.all.append(simulation)

        patch.setattr(resumed.ResumedSimulation, "__init__", init)

    @property
    def computed(self) -> int:
        return self.all[-1].n_computed


@pytest.mark.parametrize(
    ("edit", "number"),
    [(renamed, 0), (renamed, 1), (reordered, 1), (with_unused, 0), (with_note, 0)],
)
def test_edit_without_island_change_computes_nothing(
    edit, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    score, recalled = Score(), Recalled(monkeypatch)
    rendered(score, monkeypatch)
    assert recalled.computed > 0
    # Another route changes the mix, so that islands are recalled one by one.
    louder = score.text().replace("render:", _FADE)
    Path("a.yaml").write_text(louder)
    ergon.render("a.yaml")
    assert (len(recalled.all), recalled.computed) == (2, 0)
    rendered(edit(score, number), monkeypatch)
    assert recalled.computed == 0


@pytest.mark.parametrize("number", [0, 1, 3])
def test_unplayed_note_leaves_mix_unchanged(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    score, recalled = Score(), Recalled(monkeypatch)
    first = rendered(score, monkeypatch)
    n_computed = len(recalled.all)
    more = with_note(score, number)
    assert more.notes != score.notes
    assert digest(rendered(more, monkeypatch)) == digest(first)
    assert len(recalled.all) == n_computed
    scratch = rendered(more, monkeypatch, saved=False)
    assert digest(scratch) == digest(first)


def test_unplayed_instrument_displaced_at_start_recalled(monkeypatch: pytest.MonkeyPatch) -> None:
    """An instrument that nothing plays is no silence if it begins away from its rest."""
    score = Score()
    first = rendered(score, monkeypatch)
    swing = "  swing: {modules: {m: {CEL: {M: 2g, f: 300Hz, t60: 1s, X0: 1mm}}}, out: {SOX: m}}\n"
    text = score.text().replace("  chime:", f"{swing}  chime:")
    sounds = []
    for saved in ("on", "off"):
        Path("a.yaml").write_text(text)
        monkeypatch.setenv("ERGON_CACHE", saved)
        sounds.append(digest(ergon.render("a.yaml")))
    assert sounds[0] == sounds[1] != digest(first)


def test_retuned_part_computed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    score, recalled = Score(), Recalled(monkeypatch)
    rendered(score, monkeypatch)
    complete = recalled.computed
    rendered(retuned(score, 1), monkeypatch)
    assert 0 < recalled.computed < 0.7 * complete


@pytest.mark.parametrize(
    ("edit", "number"), [(renamed, 1), (reordered, 1), (with_unused, 0), (with_note, 0)]
)
def test_edit_without_island_change_reuses_plan(
    edit, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    score = Score()
    rendered(score, monkeypatch)
    Path("a.yaml").write_text(edit(score, number).text())
    assert stage_piece(read("a.yaml"), RenderOptions()).stage.is_plan_kept


def test_known_piece_excerpts_recalled(monkeypatch: pytest.MonkeyPatch) -> None:
    score, recalled = Score(), Recalled(monkeypatch)
    first = rendered(score, monkeypatch)
    n_computed = len(recalled.all)
    assert digest(rendered(score, monkeypatch)) == digest(first)
    for options in (
        {"from_": "0.7s", "until": "1.2s"},
        {"from_": "0.6s"},
        {"until": "0.8s"},
        {"from_": "0.1s", "channels": 1},
    ):
        excerpt = rendered(score, monkeypatch, **options)
        assert len(recalled.all) == n_computed
        assert digest(excerpt) == digest(rendered(score, monkeypatch, saved=False, **options))


def test_known_piece_with_auto_tail_recalled(monkeypatch: pytest.MonkeyPatch) -> None:
    recalled = Recalled(monkeypatch)
    text = Score().text().replace("tail: 0.5s", "tail: auto")
    Path("a.yaml").write_text(text)
    monkeypatch.setenv("ERGON_CACHE", "off")
    scratch = ergon.render("a.yaml")
    monkeypatch.setenv("ERGON_CACHE", "on")
    first = ergon.render("a.yaml")
    assert len(recalled.all) == 1
    again = ergon.render("a.yaml")
    assert len(recalled.all) == 1
    assert digest(scratch) == digest(first) == digest(again)


def test_limited_excerpt_of_recalled_piece(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master = "mix: {master: {normalise: -1dB, limit: -6dB}}\nrender:"
    Path("a.yaml").write_text(Score().text().replace("render:", master))
    recalled = Recalled(monkeypatch)
    sounds = []
    for saved in ("off", "on", "on"):
        monkeypatch.setenv("ERGON_CACHE", saved)
        ergon.render("a.yaml")
        sounds.append(digest(ergon.render("a.yaml", RenderOptions(from_="0.9s", until="1.3s"))))
    assert len(set(sounds)) == 1
    assert len(recalled.all) == 1


@pytest.mark.parametrize("level", ["normalise: -1dB", "loudness: -45LUFS"])
def test_excerpt_of_levelled_piece_reads_its_stretches_alone(
    level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gain of a piece that was rendered before is known without its other frames."""
    master = f"mix: {{master: {{{level}}}}}\nrender:"
    Path("a.yaml").write_text(Score().text().replace("render:", master))
    part = RenderOptions(from_="0.9s", until="1.0s")
    monkeypatch.setenv("ERGON_CACHE", "off")
    wanted = ergon.render("a.yaml", part)
    monkeypatch.setenv("ERGON_CACHE", "on")
    ergon.render("a.yaml")
    n_read = []
    find_mastered_mix = MixedStretches.find_mastered_mix

    def counted(*args: Any) -> KnownMix | None:
        mix = find_mastered_mix(*args)
        assert mix is not None
        n_read.append(sum(map(len, mix.frames)))
        return mix

    monkeypatch.setattr(MixedStretches, "find_mastered_mix", counted)
    excerpt = ergon.render("a.yaml", part)
    assert n_read[0] <= 0.1 * 8000 + stretches.STRETCH_FRAMES
    assert digest(excerpt) == digest(wanted)
    assert (excerpt.gain, excerpt.true_peak) == (wanted.gain, wanted.true_peak)


def test_end_of_piece_stays_with_its_search_for_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fold to one channel may fade at another frame, so its end is its own."""
    fading = Score(parts=tuple(part for part in Score().parts if part[0] != "b"))
    Path("a.yaml").write_text(fading.text().replace("tail: 0.5s", "tail: auto"))
    for options in (RenderOptions(), RenderOptions(channels=1), RenderOptions(from_="0.5s")):
        monkeypatch.setenv("ERGON_CACHE", "off")
        wanted = ergon.render("a.yaml", options)
        monkeypatch.setenv("ERGON_CACHE", "on")
        for _ in range(3):
            assert digest(ergon.render("a.yaml", options)) == digest(wanted)


_PARTS = ({"from_": "0.9s", "until": "1.3s"}, {"from_": "0.6s"}, {"until": "6s"}, {})
_LEVELS = ("normalise: -1dB", "loudness: -45LUFS", "loudness: -12LUFS, limit: -3dB")


@pytest.mark.parametrize("tail", ["0.5s", "8s", "auto"])
@pytest.mark.parametrize("level", few(_LEVELS, ("loudness: -45LUFS",)))
@pytest.mark.parametrize("order", few((0, 1, 2, 3), (3,)))
def test_excerpts_recall_level_of_piece(
    order: int, level: str, tail: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of them is rendered first: what it leaves is enough for others, or computed."""
    fading = Score(parts=tuple(part for part in Score().parts if part[0] != "b"))
    text = fading.text().replace("render:", f"mix: {{master: {{{level}}}}}\nrender:")
    Path("a.yaml").write_text(text.replace("tail: 0.5s", f"tail: {tail}"))
    recalled = Recalled(monkeypatch)
    parts = (*_PARTS[order:], *_PARTS[:order])
    monkeypatch.setenv("ERGON_CACHE", "off")
    scratch = [ergon.render("a.yaml", RenderOptions(**part)) for part in parts]
    monkeypatch.setenv("ERGON_CACHE", "on")
    for _ in range(2):
        for part, wanted in zip(parts, scratch, strict=True):
            done = ergon.render("a.yaml", RenderOptions(**part))
            assert digest(done) == digest(wanted)
            assert (done.gain, done.loudness) == (wanted.gain, wanted.loudness)
    # The part up to 6 s goes on after the sound has faded: it is computed if it comes later.
    is_later = tail == "auto" and "6s" not in parts[0].values()
    assert len(recalled.all) == (2 if is_later else 1)


def test_excerpt_instrument_levels_recalled(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a part measures, which is computed to the end of the piece, is known of the piece."""
    master = "mix: {master: {loudness: -24LUFS}}\nrender:"
    Path("a.yaml").write_text(Score().text().replace("render:", master))
    recalled = Recalled(monkeypatch)
    result = []
    for saved in ("off", "on", "on"):
        monkeypatch.setenv("ERGON_CACHE", saved)
        for name, part in (("part", {"from_": "0.3s", "until": "1.1s"}), ("piece", {})):
            done = ergon.render_to_file("a.yaml", f"{name}.wav", FileOptions(force=True, **part))
            result.append((done.mix.sha256, done.instruments))
    assert result[:2] == result[2:4] == result[4:]
    assert result[0] != result[1]
    assert len(recalled.all) == 1


def test_levels_recalled_with_another_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """No instrument is mixed by itself again: each is measured in units of its route's gain."""
    measured: list[list[int]] = []
    plain = KnownLevels.recall

    def recall(known: KnownLevels, *of: Any) -> list[int]:
        measured.append(plain(known, *of))
        return measured[-1]

    monkeypatch.setattr(KnownLevels, "recall", recall)
    hall = "rooms: {hall: {t60: {200Hz: 1s, 2kHz: 0.6s}, size: 5m}}"
    levels = []
    for gain in (0, -7.3):
        routes = (
            f"route: [{{from: a, to: 1}}, {{from: b, to: 1, gain: {gain}dB, send: {{hall: -9dB}}}}]"
        )
        mix = f"mix:\n  {hall}\n  {routes}\nrender:"
        Path("a.yaml").write_text(Score().text().replace("render:", mix))
        for saved in ("on", "off"):
            monkeypatch.setenv("ERGON_CACHE", saved)
            done = ergon.render_to_file("a.yaml", "a.wav", FileOptions(force=True))
            levels.append((done.mix.sha256, done.instruments))
    assert measured == [[0, 1], []]
    assert levels[0] == levels[1] != levels[2] == levels[3]
    (same, louder), (again, softer) = levels[0][1], levels[2][1]
    assert same == again
    assert softer.peak == pytest.approx(louder.peak * 10 ** (-7.3 / 20), rel=1e-12)


def test_recalled_constant_sound_faded_as_new(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its sound is the same in all stretches, but not what the mix makes of it."""
    still = "  wall: {modules: {w: {SOL: {X0: 1mm}}}, out: {SOX: w}}\n"
    text = "ergon: 1\nrates: {audio: 8kHz}\ninstruments:\n" + still + "render: {tail: 2s}\n"
    Path("a.yaml").write_text(text.replace("render:", _FADE).replace("2s", "2s, bits: float"))
    sounds = []
    for saved in ("off", "on", "on"):
        monkeypatch.setenv("ERGON_CACHE", saved)
        sounds.append(ergon.render("a.yaml"))
    assert len(set(map(digest, sounds))) == 1
    assert sounds[0].peak > 0.0


def test_unplayed_instrument_leaves_the_trials_as_they_are() -> None:
    """The work that trials may take is counted of what is computed, so their results stay."""
    from ergon.api import score as scores
    from ergon.api.options import AccuracyOptions

    trials = []
    for spare in ("", "  spare: {from: strings/dulcimer, notes: [D4, A4, D5]}\n"):
        text = Score().text().replace("  chime:", f"{spare}  chime:")
        assert spare in text
        Path("a.yaml").write_text(text)
        options = AccuracyOptions()
        plan = scores.stage_piece(scores.read("a.yaml", options), options).stage.plan
        assert plan is not None
        trials.append((plan.trials.allowed, plan.trials.done))
    assert trials[0] == trials[1]
    assert trials[0][1] > 0.0


LOOK_FRAMES = 4096  # from look to look at the energy of an island


def test_strike_added_at_a_look_after_a_recalled_stretch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The energy at rest is 0, and half of the added strike has acted when it is looked at."""
    monkeypatch.setattr(stretches, "STRETCH_FRAMES", LOOK_FRAMES * 3 // 2)
    text = """\
ergon: 1
instruments:
  bell:
    modules:
      hammer: {CEL: {M: 10g, f: 5Hz, t60: 0.2s}}
      body: {CEL: {M: 20g, f: 440Hz, t60: 0.5s}}
      contact: {BUT: {between: [hammer, body], K: 1e8, exponent: 2.5, gap: 1mm}}
    out: {SOV: body}
strikes: {late: {to: bell.hammer, at: 0.5s, impulse: 4mNs}ADDED}
mix: {channels: 1, route: [{from: bell, to: 1}]}
render: {tail: 0.2s}
"""
    added_at = 2 * LOOK_FRAMES / 44_100 - 0.1e-3
    added = f", early: {{to: bell.hammer, at: {added_at}s, impulse: 4mNs}}"
    digests = []
    for saved in ("on", "off"):
        monkeypatch.setenv("ERGON_CACHE", saved)
        for more in ("", added):
            Path("a.yaml").write_text(text.replace("ADDED", more))
            digests.append(digest(ergon.render("a.yaml", RenderOptions())))
    assert digests[:2] == digests[2:]
