"""How instruments are played: acts, strengths within their range, and the loudness of a route."""

import math
from pathlib import Path

import damped_bar
import numpy as np
import pytest
from checked import check, check_reports
from sweep import few

from ergon import _core
from ergon.instruments.model import Instrument
from ergon.notation.tables.strengths import ImpulseRange
from ergon.scores.reading.digest import digest_of
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Hit, Piece
from ergon.scores.staging.stage import stage

LIBRARY = Path(__file__).parents[2] / "instruments" / "library"
BESIDE = Path(__file__).parents[2] / "scores" / "library" / "play.yaml"
DRUMS = """\
ergon: 1
instruments:
  drum:
    modules:
      skin: {CEL: {M: 5g, f: 90Hz, t60: 0.2s}}
      rim: {CEL: {M: 1g, f: 900Hz, t60: 0.1s}}
    out: {SOV: skin}
    play:
      strike: {at: skin, impulse: 1mNs..16mNs}
      click: {at: [rim, skin], impulse: 0.1mNs..1mNs}
    level: -32LUFS
  small: {like: drum, play: {strike: {at: rim, impulse: 2mNs..8mNs}}}
  bar:
    CEL: {M: 1g, f: A4, t60: 1s}
    notes: C4..C5
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOV: bar}
  mute: {CEL: {M: 1g, f: A4, t60: 1s}, out: {SOV: mute}}
"""


def piece(text: str, head: str = DRUMS) -> Piece:
    loaded = check(head + text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


def struck(text: str) -> list[tuple[str, str]]:
    """The part and module of each target."""
    (strikes,) = piece(f"strikes: {{s: {text}}}\n").strikes
    return [(target.part, target.module) for target in strikes.to]


def impulses(text: str) -> list[tuple[float, float]]:
    """The instant [s] and impulse [N·s] of each ergon."""
    staged = stage(piece(f"tempo: {{bpm: 60}}\nstrikes: {{s: {text}}}\n"))
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    return sorted((e.at, e.impulse) for strikes in each for e in strikes)


def test_table_with_strengths():
    score_piece = piece(
        "strikes:\n  s: |\n    1|1  drum small  f\n    1|2  drum\n    1|3  small  p!\n"
    )
    (strikes,) = score_piece.strikes
    assert [hit.level.written for hit in strikes.hits] == [
        str(5 / 7),
        str(5 / 7),
        str(5 / 7),
        repr(3 / 7),
    ]


def test_instrument_struck_by_first_act():
    assert struck("{to: drum, at: 0}") == [("drum", "skin")]
    assert struck("{to: drum.click, at: 0}") == [("drum", "rim"), ("drum", "skin")]
    assert struck("{to: [drum, small], at: 0}") == [("drum", "skin"), ("small", "rim")]
    assert struck("{to: drum.rim, at: 0}") == [("drum", "rim")]


def test_notes_struck_by_act_of_each():
    (strikes,) = piece("strikes: {s: {to: bar, at: 0, notes: C4 E4, every: 1, times: 1}}\n").strikes
    assert [(t.part, t.module) for t in strikes.voices["E4"]] == [("bar.E4", "")]
    assert strikes.impulse_ranges["bar.E4"] == ImpulseRange(1e-3, 4e-3)


@pytest.mark.parametrize(
    ("level", "expected"),
    [
        ("", [16e-3 ** (4 / 7) * 1e-3 ** (3 / 7)] * 4),
        (", impulse: fff", [16e-3] * 4),
        (", impulse: ppp fff", [1e-3, 16e-3] * 2),
        (", impulse: 0 -> 1", [1e-3 * 16 ** (n / 3) for n in range(4)]),
        (", impulse: 3mNs", [3e-3] * 4),
    ],
)
def test_impulses_of_strikes(level, expected):
    ergons = impulses(f"{{to: drum, at: 0, every: 1, times: 4{level}}}")
    assert [impulse for _, impulse in ergons] == pytest.approx(expected, rel=1e-6)


def test_same_strength_different_reach():
    ergons = impulses("{to: [drum, small], at: 0, impulse: fff}")
    assert sorted(impulse for _, impulse in ergons) == pytest.approx([8e-3, 16e-3])


def test_melody_with_strengths():
    rows = "{at: 0, what: drum.strike, impulse: ppp}, {at: 1, what: [drum, small], impulse: f}"
    ergons = impulses(f"{{entries: [{rows}, {{at: 2, what: small, impulse: 3mNs}}]}}")
    drum, small = 1e-3 * 16 ** (5 / 7), 2e-3 * 4 ** (5 / 7)
    expected = sorted([(0, 1e-3), (1, drum), (1, small), (2, 3e-3)])
    assert np.array(ergons) == pytest.approx(np.array(expected), rel=1e-6)


def test_phrase_scaled_in_strength():
    text = "phrases: {p: {entries: '0 drum f', length: 1}}\n"
    text += "strikes: {s: {play: p, at: 0, do: scale 0.5}}\n"
    (strikes,) = piece(text).strikes
    (hit,) = strikes.hits
    assert isinstance(hit, Hit)
    assert hit.impulse_range == ImpulseRange(1e-3, 16e-3)
    assert hit.level.impulse(hit.impulse_range, max) == pytest.approx(0.5e-3 * 16 ** (5 / 7))


@pytest.mark.parametrize(
    ("text", "code", "part"),
    [
        ("strikes: {s: {to: mute, at: 0}}", "E103", "'mute' has no `play`"),
        ("strikes: {s: {to: mute, at: 0, impulse: f}}", "E103", "'mute' has no `play`"),
        ("strikes: {s: {to: drum.strok, at: 0}}", "E301", "nothing is called 'drum.strok'"),
        (
            "strikes: {s: {to: [drum, small], at: 0, for: 1, rate: 3Hz, impulse: f}}",
            "E111",
            "strikes by chance have one impulse",
        ),
        (
            "strikes: {s: {to: drum, at: 0, for: 1, rate: 3Hz, impulse: p f}}",
            "E111",
            "strikes by chance have one impulse",
        ),
        ("strikes: {s: {to: drum, at: 0, impulse: 100}}", "E203", "write 100mNs or 100Ns"),
        ("mix: {route: [{from: mute, to: 1, level: -20LUFS}]}", "E304", "'mute' has no `level`"),
        (
            "mix: {route: [{from: drum, to: 1, level: -20LUFS}], master: {reference: SI}}",
            "E111",
            "is not known in SI units",
        ),
    ],
)
def test_strength_and_act_mistake_messages(text, code, part):
    report = check_reports(DRUMS + text + "\n")
    (code_found, _, message), *others = report
    assert (code_found, others) == (code, [])
    assert part in message


@pytest.mark.parametrize(
    ("play", "code", "part"),
    [
        ("{strike: {at: nope, impulse: 1mNs..2mNs}}", "E301", "nothing is called 'nope'"),
        ("{strike: {at: skin, impulse: 2mNs}}", "E202", "the softest and the hardest"),
        ("{strike: {at: skin}}", "E103", "impulse"),
        ("{strike: {impulse: 1mNs..2mNs}}", "E304", "is ambiguous"),
    ],
)
def test_wrong_act_in_play_has_one_message(play, code, part):
    text = "ergon: 1\ninstruments:\n  d:\n    modules: {skin: {CEL: {M: 5g, f: 90Hz, t60: 1s}}, "
    text += (
        f"rim: {{CEL: {{M: 5g, f: 90Hz, t60: 1s}}}}}}\n    play: {play}\n    out: {{SOV: skin}}\n"
    )
    text += "strikes: {s: {to: d, at: 0}}\n"
    reports = [r for r in check(text).diagnostics if r.severity == "error"]
    assert any(r.code == code and part in r.message for r in reports)
    assert len({(r.code, r.message) for r in reports}) == len(reports)


def test_route_level_counts_from_loudness():
    score_piece = piece(
        "mix: {channels: 2, route: [{from: drum, to: [1, 2], level: -20LUFS, gain: -6dB}]}\n"
    )
    (route,) = score_piece.mix.routes
    assert route.ratio == pytest.approx(10 ** ((12 - 6) / 20) / math.sqrt(2))


def test_digest_independent_of_unplayed_acts():
    """What is played decides, not what could be played."""
    text = "strikes: {s: {to: drum.skin, at: 0, impulse: 2mNs}}\n"
    silent = DRUMS.replace("1mNs..16mNs", "1mNs..20mNs") + text
    assert digest_of(check(silent).piece) == digest_of(piece(text))


BOWED = """\
ergon: 1
rates: {audio: 44.1kHz}
tempo: {bpm: 60}
instruments:
  reed:
    modules: {m: {CEL: {M: 20g, f: 200Hz, t60: 1s}}}
    out: {SOV: m}
    play:
      bow:
        at: bow
        impulse: 0.1Ns..1Ns
        turns: true
        with: {bow: {MAS: {M: 1kg}}, hair: {FRO: {between: [bow, m], Z: 0.1Ns/m}}}
"""


def modules_of(text: str) -> set[str]:
    score_piece = piece(text, BOWED)
    return {module.name for module in score_piece.instruments["reed"].modules}


def test_act_brings_its_modules_once_played():
    assert modules_of("") == {"m"}
    assert modules_of("strikes: {s: {to: reed.m, at: 0, impulse: 1mNs}}\n") == {"m"}
    assert modules_of("strikes: {s: {to: reed, at: 0}}\n") == {"m", "bow", "hair"}
    assert modules_of("strikes: {s: {rhythm: reed, at: 0, times: 1}}\n") == {"m", "bow", "hair"}


def test_module_of_instrument_replaces_module_of_act():
    text = BOWED.replace("{m: {CEL", "{bow: {MAS: {M: 2kg}}, m: {CEL")
    score_piece = piece("strikes: {s: {to: reed.bow, at: 0, impulse: 1mNs}}\n", text)
    assert [m.name for m in score_piece.instruments["reed"].modules] == ["bow", "m"]


def test_act_alternates_sign_of_strokes():
    score_piece = piece(
        "strikes: {s: {to: reed, at: 0, every: 1, times: 4, impulse: fff}}\n", BOWED
    )
    staged = stage(score_piece)
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    assert [e.impulse for strikes in each for e in strikes] == [1.0, -1.0, 1.0, -1.0]


def test_included_score_brings_modules_of_its_acts():
    inner = BOWED + "strikes: {s: {to: reed, at: 0}}\n"
    loaded = check("ergon: 1\ninclude: [{file: inner.yaml, at: 1|1, as: v}]\n", inner=inner)
    assert loaded.piece is not None, loaded.diagnostics
    names = [module.name for module in loaded.piece.instruments["v.reed"].modules]
    assert names == ["m", "bow", "hair"]


DAMPED = damped_bar.SCORE + "tempo: {bpm: 60}\n"


def damper(fields: str) -> list[tuple[float, float]]:
    """The strikes on dampers: instants [s] and impulses [N·s]; others are stronger."""
    staged = stage(piece(f"strikes: {{s: {{{fields}}}}}\n", DAMPED))
    each = (staged.timeline.strikes_on(mat) for mat in range(staged.network.n_mat))
    strikes = [(round(e.at, 9), e.impulse) for some in each for e in some]
    return sorted(strike for strike in strikes if abs(strike[1]) < 0.05)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("rhythm: 'c4 ~', to: bar, at: 0, times: 1", [(0, -1), (2, 1)]),
        (
            "rhythm: 'c4 ~ [c4 ~]', to: bar, at: 0, times: 1, cycle: 3",
            [(0, -1), (1, 1), (2, -1), (2.5, 1)],
        ),
        ("rhythm: 'c4@3 ~', to: bar, at: 0, times: 1", [(0, -1), (3, 1)]),
        ("notes: C4 ~, to: bar, at: 0, every: 1, times: 1", [(0, -1), (1, 1)]),
        ("to: bar.C4, at: 0, every: 1, times: 2", [(0, -1), (1, 1), (1, -1)]),
        ("entries: [{at: 1, what: bar.C4, impulse: f}]", [(1, -1)]),
    ],
)
def test_release_act_lifts_and_lowers_damper(fields, expected):
    assert damper(fields) == sorted((at, sign * 0.02) for at, sign in expected)


def test_note_is_damped_where_it_ends():
    score_piece = piece("strikes: {s: {rhythm: 'c4 ~ c4@2', to: bar, at: 0, times: 1}}\n", DAMPED)
    staged = stage(score_piece)
    frames = np.zeros((int(4 * staged.rate), staged.simulation.n_out))
    staged.simulation.process(frames)
    levels = np.abs(frames).sum(axis=1)[: int(4 * staged.rate)].reshape(40, -1).max(axis=1)
    assert levels[8] > 0.3 * levels[1]  # it rings
    assert levels[15] < 1e-3 * levels[8]  # it is damped
    assert levels[38] > 0.3 * levels[21]  # and rings again


# --- the library --------------------------------------------------------------------------------


def library() -> list[tuple[str, str, Instrument]]:
    """Every instrument of the library that says how it is played: family, name, instrument."""
    instruments = []
    for path in sorted(LIBRARY.glob("*.yaml")):
        loaded = load(path)
        assert loaded.piece is not None, loaded.diagnostics
        for name in dict.fromkeys([*loaded.piece.instruments, *loaded.piece.families]):
            instrument = loaded.piece.playable_instrument(name)
            if (
                instrument is not None
                and instrument.acts
                and name not in loaded.piece.note_families()
            ):
                instruments.append((path.stem, name, instrument))
    return instruments


PLAYED = library()


def test_cards_with_strike_are_tested():
    import yaml

    cards = yaml.safe_load((LIBRARY.parents[1] / "docs/generators/cards.yaml").read_text())
    struck = {n for f in cards.values() for n, card in f["cards"].items() if "strike" in card}
    assert struck <= {name for _, name, _ in PLAYED}


def loudness(family: str, name: str, strengths: tuple[str, ...], note: str = "") -> list[float]:
    """The momentary loudness of one stroke at each strength, routed at -20 LUFS [LUFS]."""
    copies = "".join(f"  c{i}: {{from: {family}/{name}}}\n" for i in range(len(strengths)))
    routes = ", ".join(
        f"{{from: c{i}, to: {i + 1}, level: -20LUFS}}" for i in range(len(strengths))
    )
    lines = "".join(
        f"  s{i}: {{to: c{i}{note}, at: 50ms, impulse: {s}}}\n" for i, s in enumerate(strengths)
    )
    text = f"ergon: 1\nuse: [instruments/{family}.yaml]\ninstruments:\n{copies}strikes:\n{lines}"
    text += f"mix: {{route: [{routes}]}}\n"
    loaded = load(BESIDE, text=text)
    assert loaded.piece is not None, loaded.diagnostics
    staged = stage(loaded.piece)
    # What is struck is loudest in its first 0.4 s, which begin with the stroke.
    seconds = 0.75 if family in ("friction", "winds") else 0.6
    n_frames = min(int(seconds * staged.rate), staged.n_frames)
    frames = np.zeros((n_frames, staged.simulation.n_out))
    staged.simulation.process(frames)
    mixed = np.zeros((n_frames, staged.n_channels))
    reference = loaded.piece.mix.reference()
    staged.mixer(highpass=8.0, reference=reference).process(frames, mixed)
    step = int(0.05 * staged.rate)
    results = []
    for channel in mixed.T:
        meter, loudest = _core.Meter(staged.rate, 1), -math.inf
        for begin in range(0, n_frames - step + 1, step):
            meter.process(np.ascontiguousarray(channel[begin : begin + step, None]))
            loudest = max(loudest, meter.momentary)
        results.append(loudest)
    return results


STRUCK = [(family, name) for family, name, _ in PLAYED]
LONG = [("plates", "bloom"), ("plates", "cymbal")]  # whose plates are planned for long
QUICK = [pair for pair in STRUCK if pair not in LONG]


@pytest.mark.parametrize(("family", "name"), few(STRUCK, QUICK))
def test_loudness_of_instrument_from_pp_to_ff(family, name):
    note = ".C6" if name == "chimes" else ""  # else all its notes would be struck
    soft, middle, hard = loudness(family, name, ("pp", "mf", "ff"), note)
    assert soft < middle < hard
    assert 14.5 <= hard - soft <= 30
    assert middle == pytest.approx(-20, abs=1.5)
