"""What the language means exactly: from a score's text to numbers worked out elsewhere."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.linalg import expm

from ergon.scores.reading.load import load
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.stage import Stage, stage
from tests.house.test_docs import PAGES, blocks

ROOT = Path(__file__).parents[2]
RATE = 44100.0


def staged(text: str, **options: bool) -> Stage:
    loaded = load("s.yaml", text="ergon: 1\n" + text)
    assert loaded.piece is not None, loaded.diagnostics
    return stage(loaded.piece, **options)


def rendered(played: Stage, n_frames: int | None = None) -> np.ndarray:
    """Outputs before any gain (n_frames, n_out)."""
    out = np.zeros((n_frames or played.n_frames, played.simulation.n_out))
    played.simulation.process(out)
    return out


BELL = "instruments: {b: {CEL: {M: 2g, f: 300Hz, t60: 1s%s}, out: {SOX: b}}}\n"

# --- time ---


@pytest.mark.parametrize(
    ("end", "tail", "rate", "frames"),
    [
        ("1s", "", 44100, 61 * 44100),  # until it has faded, 60 s at most
        ("1.00001s", "render: {tail: 0.5s}\n", 44100, 66151),  # ceil of 66150.441
        ("0.25s", "render: {tail: 0.5s}\n", 48000, 36000),
    ],
)
def test_render_length_of_last_event_plus_tail(end, tail, rate, frames):
    rates = f"rates: {{audio: {rate}Hz}}\nstrikes: {{s: {{to: b, at: {end}, impulse: 1mNs}}}}\n"
    assert staged(BELL % "" + rates + tail).n_frames == frames


def test_render_frame_zero_and_sample_unit():
    played = staged(BELL % ", X0: 1.5mm, V0: 0.2m/s")
    result = rendered(played, 4410)[:, 0]
    sigma, omega = 3.0 * math.log(10.0), 2.0 * math.pi * 300.0
    t = np.arange(4410) / RATE
    b = (0.2 + sigma * 1.5e-3) / omega
    wanted = np.exp(-sigma * t) * (1.5e-3 * np.cos(omega * t) + b * np.sin(omega * t))
    assert result[0] == 1.5e-3
    assert np.abs(result - wanted).max() < 1e-12


@pytest.mark.parametrize("rate", [22050, 48000, 96000])
def test_instrument_motion_same_at_other_rates(rate: int):
    """Struck by clock and between samples: at common instants the bell is where it was."""
    text = BELL % "" + "strikes: {s: {to: b, at: 7ms, every: 131ms, times: 3, impulse: 1mNs}}\n"
    seconds = np.arange(1, 10) / 10.0
    first, two = (
        rendered(staged(text + f"rates: {{audio: {r}Hz}}\n"), int(r))[
            np.rint(seconds * r).astype(int)
        ]
        for r in (44100, rate)
    )
    assert np.abs(first).max() > 1e-5
    assert np.abs(first - two).max() < 1e-9 * np.abs(first).max()


def test_impulse_response_of_cell():
    """p/(mω) e^-σt sin ωt, from the sample of the instant on."""
    out = rendered(
        staged(BELL % "" + "strikes: {s: {to: b, at: 10ms, impulse: 2mNs, lasts: 0s}}\n"), 2000
    )[:, 0]
    sigma, omega, t = 3.0 * math.log(10.0), 2.0 * math.pi * 300.0, np.arange(2000) / RATE - 0.01
    wanted = 2e-3 / (2e-3 * omega) * np.exp(-sigma * t) * np.sin(omega * t)
    assert np.abs(out - np.where(t >= 0.0, wanted, 0.0)).max() < 1e-10


# --- forces ---


@pytest.mark.parametrize(
    ("link", "force"),
    [
        ("REF: {between: [a, b], K: 800N/m, rest: 1mm}", 800.0 * (3e-3 - 1e-3)),
        ("BUT: {between: [a, b], K: 800N/m, gap: 1mm}", 0.0),
        ("BUT: {between: [b, a], K: 800N/m, gap: 1mm}", -800.0 * (3e-3 - 1e-3)),
        ("BUT: {between: [a, b], K: 800N/m, gap: 1mm, side: above}", 800.0 * (3e-3 - 1e-3)),
        ("BUT: {between: [b, a], K: 5e5, exponent: 1.5}", -5e5 * 3e-3**1.5),
        ("LNL: {between: [a, b], law: 'k*d + q*d**3', k: 100N/m, q: 1e7}", 0.3 + 1e7 * 2.7e-8),
        ("LNL: {between: [a, b], points: [[0, 0], [1mm, 2N], [2mm, 3N]]}", 4.0),  # goes on
        ("LNL: {between: [a, b], damping: 'z*v', z: 2Ns/m}", 0.0),
    ],
)
def test_link_force_sign_and_size(link: str, force: float):
    """d = x_b - x_a - rest = 3 mm; f pulls a towards b: F_a += f, and SOF hears -f, that on b."""
    text = f"""\
instruments:
  i:
    modules: {{a: {{SOL: {{}}}}, b: {{SOL: {{X0: 3mm}}}}, l: {{{link}}}}}
    out: {{SOF: l}}
"""
    a, b = (1.0, -1.0) if "[a, b]" in link else (-1.0, 1.0)
    (result,) = rendered(staged(text), 1)[0]
    # `force` is what pulls a up; the second point named feels it as written there
    assert result == pytest.approx(force * (b if "[a, b]" in link else a), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("reach", [0.5, 1, 10])
def test_lever_motion_against_matrix_exponential(reach: float):
    """Key m ẍ = -Kx + s·F, body M ÿ = -F, F = k(y - s·x): against the matrix exponential."""
    text = f"""\
keys: {{k: {{M: 400g, K: 60N/m, reach: {reach}}}}}
instruments:
  i:
    modules:
      m: {{MAS: {{M: 50g, X0: 2mm}}}}
      r: {{RES: {{between: [k, m], K: 30N/m}}}}
    out: {{key: {{SOX: k}}, body: {{SOX: m}}}}
"""
    out = rendered(staged(text), 44100)
    s, k = float(reach), 30.0
    stiff = np.array([[(60.0 + s * s * k) / 0.4, -s * k / 0.4], [-s * k / 0.05, k / 0.05]])
    complete = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiff, np.zeros((2, 2))]])
    now, step = np.array([0.0, 2e-3, 0.0, 0.0]), expm(complete * 0.05)
    for n in range(0, 44100, 2205):
        assert out[n] == pytest.approx([s * now[0], now[1]], abs=2e-3 * 2e-3 * max(s, 1.0))
        now = step @ now


# --- chance ---

HANDS = """\
seed: 9
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}}
instruments: {sky: {BANK: {count: 9, f: 200Hz..2kHz, spread: random, t60: 0.5s..1s, M: 1g}}}
players: {ada: {key: k1}, remi: {key: k2}}
gestures: {knock: 0mm@0 3mm@1/8 0mm@1/4}
strikes:
  rain: {to: sky.all, at: 0, for: 3, rate: 2Hz, impulse: 1uNs..4uNs}
parts:
  ada: [{at: 0, play: knock, every: 1, times: 3, do: [jitter 9ms 0.5mm]}]
"""
MORE = (
    HANDS.replace("gestures: {", "gestures: {bow: 0mm@0 1mm@1/8 0mm@1/2, ")
    .replace(
        "  rain:", "  hail: {to: sky.3, at: 0, every: 1/4, impulse: 1uNs..4uNs, times: 9}\n  rain:"
    )
    .replace("  ada: [", "  remi: [{at: 0, play: bow, times: 4, do: [jitter 9ms 0.1mm]}]\n  ada: [")
)


def drawn(text: str) -> list[tuple[float, ...]]:
    """What chance gave ada's knocks and the rain."""
    played = staged(text, record=True)
    ada = [g for g in played.gestures if g.player == "ada"]
    points = [point for g in ada for point in zip(g.instants, g.positions, strict=True)]
    rendered(played, int(3.1 * RATE))
    ergons = played.simulation.ergons()
    places = [played.ergon_places[int(i)] for i in ergons["source"]]
    rain = [text.split("\n")[place.line - 2].lstrip().startswith("rain") for place in places]
    columns = zip(ergons["time"][rain], ergons["impulse"][rain], strict=True)
    return [*points, *((float(t), float(p)) for t, p in columns)]


def test_random_draws_independent_of_other_players():
    """A player, a gesture and strikes more: each draw depends on its own name alone."""
    few, many = drawn(HANDS), drawn(MORE)
    assert len(few) > 30
    assert many == few
    assert drawn(HANDS.replace("seed: 9", "seed: 10")) != few


def test_gesture_occurrences_draw_independently_on_beat():
    points = [tuple(zip(g.instants, g.positions, strict=True)) for g in staged(HANDS).gestures]
    assert [p[0][0] for p in points] == pytest.approx([0.0, 1.0, 2.0])
    assert len({p[1][1] for p in points}) == 3
    for index, item in enumerate(points):
        for (t, x), (wanted, mm) in zip(item[1:], [(0.125, 3.0), (0.25, 0.0)], strict=True):
            assert abs(t - index - wanted) <= 9e-3
            assert abs(x - 1e-3 * mm) <= 0.5e-3


# --- text ---

_NOTHING = "parts: {p: [{at: 0, play: g}]}\n"
PLAYED = "keys: {k: {M: 400g, K: 60N/m}}\nplayers: {p: {key: k}}\ngestures: {g: 0@0 1@2}\n"


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        (PLAYED.replace("0@0 1@2", "0@0 hold 1@2") + _NOTHING, "E2", "hold"),
        (PLAYED.replace("{key: k}", "{key: k, follow: q}") + _NOTHING, "E108", "follow"),
        (PLAYED.replace("{key: k}", "{key: k, sync: q}") + _NOTHING, "E108", "sync"),
        ("link: {tempo: 60}\n", "E108", "Link"),
        ("takes: {h: {file: a.gms}}\n", "E108", "GMS"),
        ("keys: {k: {M: 400N, K: 60N/m}}\n", "E203", "'N' does not measure mass"),
        ("keys: {k: {M: 400g, K: .nan}}\n", "E2", "K"),
        ("keys: {k: {M: -400g, K: 60N/m}}\n", "E2", "M"),
        (
            PLAYED + "parts: {p: [{at: 0, play: g, rate: 4kHz}]}\n",
            "N403",
            "a part entry has no rate",
        ),
        (PLAYED + _NOTHING + "accuracy: {error: -60dB, method: ca}\n", "E111", "method"),
        (PLAYED + _NOTHING + "accuracy: {upto: 5kHz}\n", "E103", "cents"),
        (PLAYED + _NOTHING + "accuracy: {error: 60dB}\n", "E2", "error"),
        (PLAYED.replace("{key: k}", "{key: k, hand: live, standin: g}"), "N401", "ergon duet"),
    ],
)
def test_contradicting_score_reports_code_and_name(text: str, code: str, says: str):
    found = load("s.yaml", text="ergon: 1\n" + text).diagnostics
    assert any(d.code.startswith(code) and says in d.message for d in found), found


def test_yaml_words_and_numbers_read_as_written():
    """012 is twelve, 1e3 a thousand, `no` a name; 1:30 is no position."""
    text = (
        "ergon: 1\nmarks: {no: 2|1, on: 3|1}\nkeys: {off: {M: 4e-1kg, K: 1e3, Z: 012Ns/m}}\n"
        "players: {yes: {key: off}}\n"
    )
    loaded = load("s.yaml", text=text)
    assert not loaded.diagnostics
    assert loaded.piece is not None
    assert [mark.name for mark in loaded.piece.marks] == ["no", "on"]
    fields = loaded.piece.keys["off"].modules[0].fields
    assert [fields[name] for name in "MKZ"] == [0.4, 1000.0, 12.0]
    (wrong,) = load("s.yaml", text="ergon: 1\nmarks: {A: 1:30}\n").diagnostics
    assert wrong.code == "E204"


def _snippets() -> list[tuple[str, str]]:
    result = [
        (block.where, block.text)
        for page in PAGES
        for block in blocks(page)
        if block.language == "yaml"
    ]
    folders = ("scores/library", "instruments/library", "cli/templates")
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.yaml"))]
    return result + [(path.name, path.read_text(encoding="utf-8")) for path in files]


@pytest.mark.parametrize(("where", "text"), _snippets(), ids=lambda word: word[:24])
def test_documented_yaml_parses_with_pyyaml(where: str, text: str):
    """No brackets, braces or quotes of our own: plain PyYAML takes every snippet and every file."""
    assert isinstance(yaml.safe_load(text), dict), where
    for line in text.splitlines():
        assert not re.match(r"\s*@", line), where


@pytest.mark.parametrize("seconds", [0.04, 0.06, 0.13, 0.2, 0.22, 0.25, 0.28, 0.31, 0.39, 0.5])
def test_throw_near_half_period_multiples_warns_w312(seconds: float):
    """W312 iff |sin ωh| < 0.2, with ω of the free key, damped."""
    omega = math.sqrt(60.0 / 0.4 - (1.2 / 0.8) ** 2)
    text = PLAYED.replace("K: 60N/m}", "K: 60N/m, Z: 1.2Ns/m}").replace(
        "0@0 1@2", f"0mm@0 throw 0.1mm@{seconds}s"
    )
    result = [d.code for d in staged(text + _NOTHING).diagnostics]
    assert result == (["W312"] if abs(math.sin(omega * seconds)) < 0.2 else [])


@pytest.mark.parametrize("grain", ["50ms", "120ms", "135ms", "300ms"])
def test_grain_above_quarter_period_is_refused(grain: str):
    """2π/ω is 0.516 s: the limit lies at 129 ms."""
    text = PLAYED.replace("K: 60N/m}", "K: 60N/m, Z: 1.2Ns/m}")
    text = text.replace("g: 0@0 1@2", f"g: {{notation: 0@0 1@2, grain: {grain}}}") + _NOTHING
    loaded = load("s.yaml", text="ergon: 1\n" + text)
    assert loaded.piece is not None
    if float(grain[:-2]) < 129.0:
        assert stage(loaded.piece).diagnostics == []
    else:
        with pytest.raises(StageError, match="grain"):
            stage(loaded.piece)
