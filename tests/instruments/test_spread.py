"""Links over a range of members: one contact of many points, as a bridge or a fret."""

from collections.abc import Iterable

import numpy as np
import pytest
from checked import check, check_reports, codes
from edited import opened, piece_of, value

from ergon.api.simulate import never_closed_warnings, simulate
from ergon.scores.edits import matter
from ergon.scores.staging.built_network import build_network
from ergon.scores.staging.implausible import warn_implausible
from ergon.scores.staging.reach import freeze_obstacles
from ergon.scores.staging.stage import stage
from ergon.scores.staging.version_glides import fading_links, version_glides, with_fading_links

SCORE = """\
ergon: 1
instruments:
  s:
    modules:
      body: {STRING: {masses: 20, M: 2g, f: A2, t60: 2s}}
      wall: %s
%s
    out: {x: {SOX: body.15}, f: {SOF: %s}}
strikes: {a: {to: s.body.12, at: 0, impulse: 1mNs}}
accuracy: {method: ca}
render: {bits: float, tail: 0.2s}
"""
SOL = "{SOL: {}}"
K = "K: 20kN/m, Z: 5mNs/m"


def rendered(lines: str, force: str, wall: str = SOL, method: str = "ca") -> np.ndarray:
    """Outputs of the scene (n_frames, 2)."""
    text = SCORE.replace("method: ca", f"method: {method}") % (wall, lines, force)
    built = stage(check(text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


GAPS = ("1um", "2um", "3um", "4um", "5um")
LIST = f"[{', '.join(GAPS)}]"


def by_hand(gaps: Iterable[str], first: int) -> str:
    return "\n".join(
        f"      c{i}: {{BUT: {{between: [wall, body.{first + i}], {K}, gap: {gap}}}}}"
        for i, gap in enumerate(gaps)
    )


def over(first: int, last: int, gap: str) -> str:
    return f"      c: {{BUT: {{between: [wall, body.{first}..{last}], {K}, gap: {gap}}}}}"


def same(ours: np.ndarray, other: np.ndarray) -> bool:
    """The same movement to the last bit; a force is summed up in another order."""
    close = np.abs(ours[:, 1] - other[:, 1]).max() <= 1e-12 * np.abs(other[:, 1]).max()
    return bool((ours[:, 0] == other[:, 0]).all() and close)


def parabola(n: int, depth: float, *, least: float = 0.0, top: float = 0.0, length: float) -> list:
    return [least + depth * (abs(i - top) / length) ** 2 for i in range(n)]


CASES = {
    "one for all": ("40um", [40e-6] * 5),
    "a list": ("[10um, 20um, 5um, 0mm, 0.1mm]", [10e-6, 20e-6, 5e-6, 0.0, 1e-4]),
    "a parabola": ("{depth: 80um}", parabola(5, 80e-6, length=4.0)),
    "a short one": ("{depth: 20um, length: 2}", parabola(5, 20e-6, length=2.0)),
    "from a top beyond": (
        "{depth: 54um, top: -2, length: 3, least: 4um}",
        parabola(5, 54e-6, least=4e-6, top=-2.0, length=3.0),
    ),
    "round its middle": ("{depth: 40um, top: 2}", parabola(5, 40e-6, top=2.0, length=2.0)),
    "a slope": ("{depth: 40um, power: 1}", [i * 10e-6 for i in range(5)]),
}


@pytest.mark.parametrize("name", CASES)
def test_spread_contact_equals_one_contact_for_each_member(name: str):
    gap, gaps = CASES[name]
    ours = rendered(over(3, 7, gap), "{BUT: c}")
    hand = rendered(by_hand((f"{gap!r}m" for gap in gaps), 3), "[c0, c1, c2, c3, c4]")
    assert np.abs(hand[:, 1]).max() > 1e-3  # they touch
    assert np.abs(ours - hand).max(axis=0) == pytest.approx(0.0, abs=1e-12 * np.abs(hand).max())


def test_spread_contact_samples_equal_single_contacts():
    ours = rendered(over(3, 7, LIST), "{BUT: c}")
    assert same(ours, rendered(by_hand(GAPS, 3), "[c0, c1, c2, c3, c4]"))


def test_spread_contact_force_is_sum_of_points():
    line = over(3, 7, "{depth: 40um}")
    complete, some = rendered(line, "{BUT: c}")[:, 1], rendered(line, "c.1..3")[:, 1]
    points = [rendered(line, f"c.{i}")[:, 1] for i in range(5)]
    assert np.abs(complete - sum(points)).max() < 1e-12 * np.abs(complete).max()
    assert np.abs(some - sum(points[1:4])).max() < 1e-12 * np.abs(complete).max()
    assert all(np.abs(own).max() > 0.0 for own in points[:2])


def test_spread_contact_with_moving_obstacle():
    wall = "{CEL: {M: 1g, f: 200Hz, t60: 0.2s}}"
    ours = rendered(over(3, 7, LIST), "{BUT: c}", wall)
    hand = rendered(by_hand(GAPS, 3), "[c0, c1, c2, c3, c4]", wall)
    assert same(ours, hand)
    assert (ours[:, 0] != rendered(over(3, 7, LIST), "{BUT: c}")[:, 0]).any()


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("FRO", "Z: 20mNs/m"),
        ("REF", "K: 2kN/m, Z: 10mNs/m, rest: 0.01mm"),
        ("LNL", "law: k*d + q*d**3, k: 100, q: 1e9"),
        ("BRISTLE", "sigma0: 1kN/m, Fc: 1mN"),
        ("DRY", "F: 1mN"),
    ],
)
def test_spread_links_of_every_kind(kind: str, fields: str):
    ours = rendered(f"      c: {{{kind}: {{between: [wall, body.3..5], {fields}}}}}", "c")
    lines = [
        f"      c{i}: {{{kind}: {{between: [wall, body.{i}], {fields}}}}}" for i in range(3, 6)
    ]
    hand = rendered("\n".join(lines), "[c3, c4, c5]")
    assert np.abs(hand[:, 1]).max() > 0.0
    assert same(ours, hand)


def test_spread_link_between_two_ranges():
    wall = "{STRING: {masses: 8, M: 4g, f: A3, t60: 1s}}"
    ours = rendered(
        f"      c: {{BUT: {{between: [wall.2..4, body.6..8], {K}, gap: 10um}}}}", "c", wall
    )
    lines = [
        f"      c{i}: {{BUT: {{between: [wall.{2 + i}, body.{6 + i}], {K}, gap: 10um}}}}"
        for i in range(3)
    ]
    assert same(ours, rendered("\n".join(lines), "[c0, c1, c2]", wall))


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        (over(3, 20, "0mm"), "E304", "members 0 to 19"),
        (over(7, 3, "0mm"), "E304", "runs downwards"),
        (over(3, 7, "[1um, 2um]"), "E106", "the number of items is 2, but must be 5"),
        (over(3, 7, "{depth: 1um, length: 0}"), "E202", "length"),
        (over(3, 7, "{depth: 1um, power: 0.5}"), "E202", "power"),
        (over(3, 7, "{least: 1um}"), "E103", "depth"),
        (over(3, 7, "{dept: 1um}"), "E101", "dept"),
        (over(3, 7, "1g"), "E203", "gap"),
        (
            "      c: {BUT: {between: [wall, body.3], K: 1N/m, gap: [1um, 2um]}}",
            "E106",
            "two single points",
        ),
        ("      c: {BUT: {between: [wall, body], K: 1N/m}}", "E304", "20 masses"),
        (
            "      c: {BUT: {between: [body.1..3, body.5..8], K: 1N/m}}",
            "E304",
            "ranges of one length",
        ),
        (
            "      c: {BUT: {between: [body.4, body.3..5], K: 1N/m}}",
            "E304",
            "both ends are body.4; a link joins two different points",
        ),
    ],
)
def test_wrong_spread_contacts_report_code_and_line(line: str, code: str, words: str):
    text = SCORE % (SOL, line, "c")
    reports = [report for report in check_reports(text) if report[0] == code]
    assert len(reports) == 1, check_reports(text)
    assert reports[0][1] == 7  # its line
    assert words in reports[0][2]


def test_spread_contact_output_member_out_of_range():
    reports = check_reports(SCORE % (SOL, over(3, 7, "0mm"), "c.5"))
    assert [report[0] for report in reports] == ["E304"]
    assert "members 0 to 4" in reports[0][2]
    single = SCORE % (SOL, over(3, 3, "0mm"), "c.0")
    assert "no members" in check_reports(single)[0][2]


def warned(line: str, wall: str = SOL) -> list:
    return warn_implausible(check(SCORE % (wall, line, "c")).piece)


def test_spread_contact_negative_gap_warns_w327():
    (output,) = warned(over(3, 7, "[0mm, -1mm, -3mm, 1mm, 0mm]"))
    assert output.code == "W327"
    assert "'s.c' is negative" in output.message
    assert "3 mm" in output.message
    assert output.place.line == 7
    assert [one.code for one in warned(over(3, 7, "{depth: -2mm}"))] == ["W327"]
    assert warned(over(3, 7, "{depth: -2mm, least: 2mm}")) == []  # hollow, and never pressed


def test_spread_contact_on_light_obstacle_warns_w328():
    wall = "{MAS: {M: 0.1g}}"
    line = over(0, 19, "0mm").replace("20kN/m", "100kN/m")
    assert [one.code for one in warned(line, wall)] == ["W328"]
    assert warned(line) == []  # a wall that holds still


def test_spread_contact_never_closed_warning():
    piece = check(SCORE % (SOL, over(3, 7, "[9mm, 9mm, 10um, 9mm, 9mm]"), "c")).piece
    assert never_closed_warnings(piece, simulate(piece, "test")) == []
    piece = check(SCORE % (SOL, over(3, 7, "[9mm, 8mm, 7mm, 6mm, 9mm]"), "c")).piece
    done = simulate(piece, "test")
    assert [one.contact.name for one in done.contacts] == [f"s.c.{i}" for i in range(5)]
    (output,) = never_closed_warnings(piece, done)
    assert output.code == "W320"
    assert "contact 's.c' never closes" in output.message
    assert "s.body.6" in output.message  # the nearest


def test_spread_contact_stiffness_glide():
    line = over(3, 7, LIST)
    glide = "automation: [{at: 0, set: s.c.K, to: x4@0 line x1@100ms}]\n"
    ours = check(SCORE % (SOL, line, "c") + glide).piece
    hand = by_hand(GAPS, 3)
    lines = "".join(f"  - {{at: 0, set: s.c{i}.K, to: x4@0 line x1@100ms}}\n" for i in range(5))
    other = check(SCORE % (SOL, hand, "[c0, c1, c2, c3, c4]") + f"automation:\n{lines}").piece
    sounds = []
    for piece in (ours, other):
        built = stage(piece, planned=True)
        sounds.append(np.empty((built.n_frames, 2)))
        built.simulation.process(sounds[-1])
    assert same(*sounds)
    assert (sounds[0] != rendered(line, "c")).any()


def test_spread_contact_gaps_unchanged_by_transpose():
    text = SCORE % (SOL, over(3, 7, "{depth: 40um}"), "c")
    text = text.replace("strikes:", "  t: {like: s, transpose: 7st}\nstrikes:")
    piece = check(text).piece
    gaps = [
        next(m for m in piece.instruments[name].modules if m.name == "c").fields["gap"]
        for name in ("s", "t")
    ]
    assert gaps[0] == gaps[1] == pytest.approx(parabola(5, 40e-6, length=4.0))


def test_duet_coupling_refuses_gap_list():
    text = """\
    ergon: 1
    keys: {a: {M: 1kg, K: 1N/m}, b: {M: 1kg, K: 1N/m}}
    duet: [{couple: [a, b], BUT: {K: 1N/m, gap: %s}, at: 0}]
    """
    assert codes(text % "1mm") == []
    assert codes(text % "[1mm, 2mm]") == ["E106"]
    assert check(text % "{depth: 1mm, least: 2mm}").piece.duet[0].link.fields["gap"] == 2e-3


def test_spread_gap_profile_scaled_and_replaced_by_set(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(SCORE % (SOL, over(3, 7, "{depth: 16um}"), "c"))
    texts, piece = opened(path)
    after = piece_of(matter.set_value(texts, piece, "s.c.gap", "x2"))
    assert value(after, "s.c.gap") == pytest.approx(parabola(5, 32e-6, length=4.0))
    after = piece_of(matter.set_value(texts, piece, "s.c.gap", "0.1mm"))
    assert value(after, "s.c.gap") == 1e-4


def test_spread_contact_points_fade_in_and_out():
    """A session lets links come from no force and let go: those of a range too."""
    short, long = (check(SCORE % (SOL, over(3, last, "0mm"), "c")).piece for last in (5, 7))
    coming = version_glides(short, long, (), 0.0, 0.1)
    assert [(one.module, one.initial_values, one.final_values) for one in coming] == [
        ("c.3", (0.0,), (2e4,)),
        ("c.4", (0.0,), (2e4,)),
    ]
    going = fading_links(long, short, (), (), 0.0)
    assert [one.glide.module for one in going] == ["c.3", "c.4"]
    saved = with_fading_links(short, going)
    assert {one.glide.module_key for one in going} == {("s", "c")}
    assert build_network(saved, ()).network.n_lia == build_network(long, ()).network.n_lia
    # A new value of K is one glide of all points.
    stiffer = check((SCORE % (SOL, over(3, 7, "0mm"), "c")).replace("20kN/m", "40kN/m")).piece
    assert [one.module for one in version_glides(long, stiffer, (), 0.0, 0.1)] == ["c"]


def test_freeze_refused_for_hand_through_spread_contact():
    text = """\
    ergon: 1
    keys: {k1: {M: 1kg, K: 1N/m}}
    players: {ada: {key: k1, hand: live}}
    instruments:
      bars:
        modules:
          row: {BANK: {count: 6, M: 1g, f: 100Hz..600Hz, t60: 1s}}
          c: {BUT: {between: [k1, row.2..4], K: 1kN/m, gap: 1mm}}
        out: {low: {SOX: row.1}, high: {SOX: row.4}}
    mix: {route: [{from: bars.%s, to: 1}]}
    """
    reached = [
        freeze_obstacles(check(text % name).piece, ["bars"], ["ada"]) for name in ("high", "low")
    ]
    assert "can feel it through bars.c" in str(reached[0][0])
    assert reached[1] == []
