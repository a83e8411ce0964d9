"""Rules of the formalism: what modules join, which laws they name, what an output hears."""

import pytest
from checked import check, check_reports, codes

from ergon.scores.reading.digest import digest_of

NETWORK = """\
ergon: 1
instruments:
  i:
    modules:
      m: {MAS: {M: 1g}}
      n: {MAS: {M: 1g}}
      s: {STRING: {masses: 9, M: 1g, f: A3}}
      r: {REF: {between: [m, n], K: 1}}
      %s
    out: %s
"""


@pytest.mark.parametrize(
    ("module", "out", "code", "part"),
    [
        ("x: {REF: {between: [m, m], K: 1}}", "{}", "E304", "two different points"),
        ("x: {REF: {between: [m, r], K: 1}}", "{}", "E304", "joins <M> points only"),
        ("x: {REF: {between: [m], K: 1}}", "{}", "E106", "is 1, but must be 2"),
        ("x: {REF: {between: [m, s], K: 1}}", "{}", "E304", "9 masses"),
        ("x: {REF: {between: [m, s.9], K: 1}}", "{}", "E304", "members 0 to 8"),
        ("x: {ENF: {to: s.all, from: 1N}}", "{}", "E304", "one MAT"),
        ("x: {REF: {between: [m, m.0], K: 1}}", "{}", "E304", "no members"),
        ("x: {REF: {between: [m, q], K: 1}}", "{}", "E301", "nothing is called 'q'"),
        ("x: {REF: {between: [m, n]}}", "{}", "E103", "K or Z"),
        ("x: {CEL: {M: 1g, K: 1, f: A3}}", "{}", "E111", "too"),
        ("x: {CEL: {M: 1g}}", "{}", "E103", "needs K"),
        ("x: {CEL: {M: -1g, K: 1}}", "{}", "E202", "not positive"),
        ("x: {CEL: {M: 1g, K: .inf}}", "{}", "E201", "finite"),
        ("x: {BANK: {count: 1e11, M: 1g, f: 20Hz..1kHz, t60: 1s}}", "{}", "E202", "outside"),
        ("x: {BUT: {between: [m, n], K: 1, contact: magic}}", "{}", "E111", "magic"),
        ("x: {MAS: {M: 1g}, SOL: {}}", "{}", "E111", "two kinds"),
        ("x: {}", "{}", "E103", "no kind"),
        ("x: {ENX: &e {to: m, from: 1mm}}\n      y: {ENX: *e}", "{}", "E304", "only forces"),
        ("x: {ENX: {to: m, from: hand}}", "{}", "E301", "neither a take"),
        ("x: {ENF: {to: m, from: tgr0.3}}", "{}", "E108", "axis"),
        ("x: {LNL: {between: [m, n], law: k*d, k: 1N/m, q: 3}}", "{}", "E101", "no constant 'q'"),
        ("x: {LNL: {between: [m, n], law: cubik}}", "{}", "E301", "no law"),
        ("x: {SOL: {}}", "{SOX: r}", "E304", "a REF"),
        ("x: {SOL: {}}", "{SOF: m}", "E304", "force of a link"),
        ("x: {SOL: {}}", "{SOX: [m, o]}", "E301", "'o'"),
        ("m: {SOL: {}}", "{}", "E102", "already defined"),
    ],
)
def test_module_rules_report_code_and_text(module, out, code, part):
    reports = check_reports(NETWORK % (module, out))
    assert [report[0] for report in reports] == [code]
    assert part in reports[0][2]


def test_output_members_by_range_and_last():
    text = NETWORK % (
        "x: {SOL: {}}",
        "{a: {SOX: s.3..5}, b: {SOX: [m, s.last]}, c: {SOF: {REF: r}}}",
    )
    a, b, c = check(text).piece.instruments["i"].outputs
    assert [(t.first, t.count) for t in a.targets] == [(3, 3)]
    assert [(t.module, t.first) for t in b.targets] == [("m", 0), ("s", 8)]
    assert c.targets[0].module == "r"


def test_units_ca_rate_and_values():
    text = """\
    ergon: 1
    instruments:
      i: {units: ca, at: 44100Hz, modules: {m: {CEL: {M: 1, K: 0.01, Z: 1e-4}}}, out: {SOX: m}}
    """
    built = check(text).piece.instruments["i"]
    assert built.ca_rate == 44100.0
    assert built.modules[0].fields["K"] == 0.01
    assert codes(text.replace("K: 0.01", "K: 1N/m")) == ["E203"]
    assert codes(text.replace(", at: 44100Hz", "")) == ["E103"]


def law(fields: str) -> str:
    return (
        "ergon: 1\n"
        "instruments:\n"
        "  i:\n"
        "    modules:\n"
        "      g: {SOL: {}}\n"
        "      m: {MAS: {M: 10g}}\n"
        f"      l: {{LNL: {{between: [g, m], {fields}}}}}\n"
        "    out: {SOX: m}\n"
    )


def test_law_points_with_units():
    bare, written = (
        digest_of(check(law(f"points: {points}")).piece)
        for points in ("[[-0.001, -2], [0, 0]]", "[[-1mm, -2N], [0, 0]]")
    )
    assert bare == written


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ("[[-1N, -2N], [0, 0]]", ["E203"]),
        ("[[-1mm, 2mm], [0, 0], [x, 1]]", ["E203", "E201"]),
        ("[[0, 0, 0], [1mm, 1N]]", ["E106"]),
        ("[[1mm, 1N], [0, 0]]", ["E207"]),
    ],
)
def test_law_points_mistakes_with_place(points, expected):
    assert codes(law(f"points: {points}")) == expected


def test_law_unknown_constant_suggestion():
    (result,) = check(law("law: rope, kk: 3")).diagnostics
    assert result.suggestion == "k"
    (result,) = check(law("law: rope, stiff: 3")).diagnostics
    assert result.help is not None
    assert "max" not in result.help


COUPLED = """\
ergon: 1
laws: {mine: {law: k*d + q*d**3, k: 40N/m, q: 1e5}}
keys: {k1: {M: 400g, K: 60N/m}, k2: {like: k1}}
duet: {couple: [k1, k2], LNL: {%s}}
"""


def test_duet_coupling_with_named_laws():
    link = check(COUPLED % "law: mine, k: 50N/m").piece.duet[0].link
    assert link.fields["law"] == "k*d + q*d**3"
    assert link.fields["constants"] == {"k": 50.0, "q": 1e5}
    assert codes(COUPLED % "law: cubic") == []
    assert codes(COUPLED % "law: cubick") == ["E301"]
    assert codes(COUPLED % "law: k*d") == ["E207"]


def test_key_without_struck_module_reported_once():
    assert codes("ergon: 1\nkeys: {k: {modules: {m: {MAS: {M: 1kg}}}}}\n") == ["E103"]


@pytest.mark.parametrize(
    "module", ["STRING: {masses: 5, M: 1g, f: 99Hz", "CHAIN: {masses: 5, M: 1g"]
)
def test_row_field_held_suggests_ends(module: str) -> None:
    """A net has `held`, and a row `ends`."""
    text = f"ergon: 1\ninstruments: {{a: {{modules: {{m: {{{module}, held: left}}}}}}}}}}\n"
    if module.startswith("CHAIN"):
        text = text.replace("{modules", "{space: 2, modules")
    result = next(one for one in check(text).diagnostics if one.code == "E101")
    assert result.suggestion == "ends"
