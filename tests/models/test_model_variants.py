"""Models laid out as other programs and editors lay them out, beside interpreters of a plain
layout: sample for sample.
"""

import random
import re
from pathlib import Path

import pytest
from imported import rendered
from models_compared import RATE, miphysics_off, off, pmpd_score
from oracle import mims, pmpd

from ergon.workshop.models.mims.grammar import Dialect
from ergon.workshop.models.mims.reading import parse, read_text
from ergon.workshop.models.mims.score import score_text

FRAMES = 500


def number(chance: random.Random, low: float, high: float) -> float:
    """A number that each of the spellings below says in full."""
    return round(chance.uniform(low, high), 4)


def spelled(chance: random.Random, value: float) -> str:
    """A number as a program writes it: `.5`, `5e-01`, `+0.5`, `0.500000`."""
    short = f"{value:.6g}"
    forms = [short, f"{value:.6f}", f"{value:.6e}", f"{value:.6E}"]
    if value >= 0.0:
        forms.append(f"+{short}")
    forms.append(re.sub(r"^(-?)0\.", r"\1.", short))
    return chance.choice(forms)


def encoded(chance: random.Random, text: str) -> bytes:
    """The bytes of a text, with one of the line ends and in one of the codings of editors."""
    text = text.replace("\n", chance.choice(["\n", "\r\n", "\r"]))
    coding = chance.choice(["utf-8", "utf-8-sig", "latin-1"])
    return text.encode(coding)


# --- pmpd~ ----------------------------------------------------------------------------------------


def chain(chance: random.Random) -> list[tuple[str, list[float]]]:
    """Messages to pmpd~: a row of masses that a wall holds, some fields left out."""
    n = chance.randrange(2, 9)
    messages: list[tuple[str, list[float]]] = [("mass", chance.choice([[], [0.0], [0.0, 0.0]]))]
    messages += [
        ("mass", [chance.randrange(2, 40), number(chance, -0.5, 0.5)][: chance.choice([1, 2, 2])])
        for _ in range(n)
    ]
    for mass in range(n):
        ends = [mass, mass + 1] if chance.random() < 0.7 else [mass + 1, mass]
        values = [number(chance, 0.01, 0.1), number(chance, 0.0, 0.005)]
        messages.append(("link", [*ends, *values[: chance.choice([1, 2, 2])]]))
    messages.append(("pos", [n, 0.4]))
    return [*messages, ("outPos", [0, chance.randrange(1, n + 1), 1.0]), ("outPos", [0, n, 0.5])]


def pure_data_text(chance: random.Random, messages: list[tuple[str, list[float]]]) -> str:
    """Messages as a text of Pure Data, a list of lines or a message box."""
    rows = [
        " ".join([word, *(str(int(x)) if x == int(x) else spelled(chance, x) for x in rest)])
        for word, rest in messages
    ]
    match chance.randrange(4):
        case 0:
            text = "\n".join(rows)
        case 1:  # as [text] and [qlist] save
            text = ";\n".join(rows) + ";\n"
        case 2:  # a message box: escaped commas, broken at 80 characters
            text = re.sub(r"(.{60,75}) ", r"\1\n", " \\, ".join(rows) + ";")
        case _:
            text = chance.choice(["; ", " ;\n\n", ";\t"]).join(rows) + chance.choice([";", ";\n\n"])
    head = chance.choice(["", "# a chain\n", "#\n# Grün\n", "\n\n"])
    return head + chance.choice(["pmpd~ 1 1;\n" if ";" in text else "pmpd~ 1 1\n", ""]) + text


@pytest.mark.parametrize("seed", range(30))
def test_pmpd_lists_of_other_programs(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    messages = chain(chance)
    path = tmp_path / "list.txt"
    path.write_bytes(encoded(chance, pure_data_text(chance, messages)))
    plain = "\n".join(" ".join([word, *map(repr, rest)]) for word, rest in messages)
    exact = pmpd.audio(plain, FRAMES)
    score = pmpd_score(read_text(path), "pmpd~")
    assert off(rendered(score, (FRAMES + 1) / RATE)[1:], exact) < 1e-9


# --- mi-gen and MIMS ------------------------------------------------------------------------------


def mims_rows(chance: random.Random, dialect: Dialect) -> list[list[str]]:
    """Statements of a row of masses, with parameters before or behind their use."""
    n = chance.randrange(1, 6)
    mass, spring = f"{number(chance, 1, 5)}", f"{number(chance, 0.01, 0.05)}"
    rows = [["@g", "ground", "0"]]
    params = [["@M", "param", mass], ["@kScale", "param", spring]]
    is_before = chance.random() < 0.5
    rows += params if is_before else []
    for i in range(n):
        x0 = f"{number(chance, -1, 1)}"
        # The last place of a mass: v1 names the place before, v2 the speed.
        second = x0 if dialect == "v1" else f"{number(chance, -20, 20)}"
        rows.append([f"@m{i}", "mass", chance.choice(["M", "3", "2.5"]), x0, second])
    for i in range(n):
        before = f"@m{i - 1}" if i else "@g"
        rows.append([f"@l{i}", "springDamper", before, f"@m{i}", "kScale", f"{0.001 * (1 + i):g}"])
    rows.append(["@out1", "posOutput", f"@m{n - 1}"])
    return rows + ([] if is_before else params)


def mims_text(chance: random.Random, rows: list[list[str]], dialect: Dialect) -> str:
    """Statements with the blanks, comments and prose that authors put between them."""
    lines = []
    for row in rows:
        if chance.random() < 0.3:
            remarks = ["", "   ", "# a remark with @m0 in it", "#"]
            lines.append(chance.choice([*remarks, "Grün"] if dialect == "v2" else remarks))
        words = [
            spelled(chance, float(word)) if re.fullmatch(r"-?\d*\.\d+", word) else word
            for word in row
        ]
        if dialect == "v2":  # mi-gen takes words apart at a +
            words = [word.replace("+", "") for word in words]
        line = chance.choice(["", "", "  ", "\t"])
        line += chance.choice([" ", "  ", "\t"]).join(words)
        if dialect == "v1" and chance.random() < 0.2:
            line += " # behind a statement"
        lines.append(line + chance.choice(["", "", " ", "\t"]))
    return "\n".join(lines) + chance.choice(["", "\n", "\n\n"])


@pytest.mark.parametrize("dialect", ["v1", "v2"])
@pytest.mark.parametrize("seed", range(30))
def test_mdl_files_of_other_programs(seed: int, dialect: Dialect, tmp_path: Path) -> None:
    chance = random.Random(seed)
    rows = mims_rows(chance, dialect)
    path = tmp_path / "model.mdl"
    path.write_bytes(encoded(chance, mims_text(chance, rows, dialect)))
    params = [row for row in rows if row[1] == "param"]
    plain = "\n".join(" ".join(row) for row in [*params, *[r for r in rows if r not in params]])
    sound = rendered(score_text(parse(read_text(path), dialect)), FRAMES / RATE)
    assert off(sound, mims.played(plain, dialect, FRAMES / RATE)) < 1e-9


# --- miPhysics ------------------------------------------------------------------------------------


def physics_elements(chance: random.Random) -> tuple[str, list[tuple[str, str, dict[str, str]]]]:
    """A model of a tied row of masses: section, kind and attributes of each element."""
    n = chance.randrange(1, 5)
    places = [(0.0, 0.0, 60.0 * i) for i in range(n + 1)]
    elements = [("MAT", "Ground3D", {"name": "g", **place("initPos", places[0])})]
    for i in range(1, n + 1):
        speed = (0.0, 0.0, float(chance.randrange(-900, 900)) + 0.5)
        values = {"mass": f"{chance.uniform(1, 6):.4f}"}
        values |= place("initPos", places[i]) | place("initVel", speed)
        elements.append(("MAT", "Mass3D", {"name": f"m{i}", **values}))
    for i in range(1, n + 1):
        ends = {"name": f"l{i}", "m1": f"m{i - 1}" if i > 1 else "g", "m2": f"m{i}"}
        values = {"stiffness": f"{chance.uniform(0.005, 0.02):.6f}", "damping": "0.003"}
        values["drest"] = f"{chance.uniform(55, 65):.3f}"
        elements.append(("Link", "SpringDamper3D", ends | values))
    return f"{chance.choice([0.0, 1e-3]):g}", elements


def place(name: str, values: tuple[float, float, float]) -> dict[str, str]:
    return {f"{name}.{axis}": f"{x:g}" for axis, x in zip("xyz", values, strict=True)}


def physics_text(
    chance: random.Random | None, friction: str, elements: list[tuple[str, str, dict[str, str]]]
) -> str:
    """The XML of a model: an element a line; with `chance` as XML writers lay it out."""
    global_tags = [("gravity", {"gravity": "0"}), ("friction", {"friction": friction})]
    global_tags.append(("vector", {"pos.x": "0", "pos.y": "0", "pos.z": "1"}))
    rows = ["<Model.xml>", "<global>", *(tag(chance, word, each) for word, each in global_tags)]
    rows.append("</global>")
    for section in ("MAT", "Link"):
        rows.append(f"<{section}>")
        for kind in dict.fromkeys(kind for where, kind, _ in elements if where == section):
            rows.append(f"<{kind}>")
            item = "mass" if section == "MAT" else "interaction"
            members = [each for _, name, each in elements if name == kind]
            rows += [tag(chance, f"{item}_{i}", each) for i, each in enumerate(members)]
            rows.append(f"</{kind}>")
        rows.append(f"</{section}>")
    rows.append("</Model.xml>")
    if chance is None:
        return "\n".join(rows)
    head = chance.choice(["", '<?xml version="1.0"?>\n', "<?xml version='1.0' ?>\n<!-- Grün -->\n"])
    if chance.random() < 0.3:
        rows.insert(2, "<!-- <Mass3D> -->")
    return head + chance.choice(["\n", "", "\n\t\n"]).join(rows) + chance.choice(["", "\n"])


def tag(chance: random.Random | None, word: str, attributes: dict[str, str]) -> str:
    """An element without content."""
    if chance is None:
        return f"<{word} " + " ".join(f'{name}="{x}"' for name, x in attributes.items()) + "/>"
    listed = [*attributes.items()]
    chance.shuffle(listed)
    if chance.random() < 0.2:
        listed.append(("color", "255"))
    quote = chance.choice("\"'")
    gap = chance.choice([" ", "  ", "\n    "])
    parts = [f"{name}{chance.choice(['=', ' = '])}{quote}{x}{quote}" for name, x in listed]
    return f"<{word} {gap.join(parts)}" + chance.choice(["/>", " />", f"></{word}>"])


@pytest.mark.parametrize("seed", range(30))
def test_miphysics_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    friction, elements = physics_elements(chance)
    plain = physics_text(None, friction, elements)
    text = physics_text(chance, friction, elements)
    path = tmp_path / "model.xml"
    ends = chance.choice(["\n", "\r\n"])
    path.write_bytes(text.replace("\n", ends).encode(chance.choice(["utf-8", "utf-8-sig"])))
    assert miphysics_off(read_text(path), FRAMES, played_text=plain) < 1e-9
