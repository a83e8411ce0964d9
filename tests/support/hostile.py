"""Hostile scores, by family: each of them must be refused."""

from collections.abc import Callable, Mapping

HEAD = "ergon: 1\n"
KEY = "keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}\nplayers: {p: {key: k}}\n"
BELL = (
    "instruments:\n  bell:\n    modules:\n      m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}\n"
    "      b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}}\n    out: {SOX: m}\n"
)
PLAY = "gestures: {g: 0mm@0 1mm@1 0mm@2}\nparts: {p: [{at: 0, play: g}]}\n"
SKY = (
    "instruments:\n  sky:\n    BANK: {count: 100, f: 20Hz..10kHz, t60: 1s, M: 1g}\n"
    "    out: {SOX: sky.all}\n"
)
NOT_NUMBERS = ("nan", ".nan", "NaN", "inf", "-inf", ".inf", "1e400", "1e1000000", "1_000", "0x10")


def piece(old: str = "", new: str = "", more: str = "") -> str:
    """A whole score with one place replaced."""
    text = HEAD + KEY + BELL + PLAY + more
    assert old in text
    return text.replace(old, new)


def generator(body: str) -> str:
    return HEAD + f"instruments:\n  x: {{{body}, out: {{SOX: x.all}}}}\n"


def module(body: str) -> str:
    return HEAD + f"instruments:\n  x:\n    modules: {{m: {body}}}\n    out: {{SOX: m}}\n"


def law(text: str) -> str:
    cell = "{CEL: {M: 1g, f: 100Hz}}"
    link = f'{{LNL: {{between: [a, b], law: "{text}"}}}}'
    return HEAD + (
        f"instruments:\n  x:\n    modules:\n      a: {cell}\n      b: {cell}\n      l: {link}\n"
        "    out: {SOX: a}\n"
    )


def gesture(notation: str) -> str:
    return HEAD + KEY + f"gestures: {{g: {notation}}}\nparts: {{p: [{{at: 0, play: g}}]}}\n"


def strikes(fields: str) -> str:
    return HEAD + SKY + f"strikes: {{r: {{to: sky.all, at: 0, {fields}, impulse: 1uNs}}}}\n"


def take(file: str) -> str:
    return HEAD + KEY + f"takes: {{t: {{file: '{file}'}}}}\nparts: {{p: [{{at: 0, play: t}}]}}\n"


YAML: Mapping[str, str | bytes | Callable[[], bytes]] = {
    "deep flow": HEAD + "x: " + "[" * 10_000 + "]" * 10_000,
    "deep maps": HEAD + "x: " + "{a: " * 10_000 + "}" * 10_000,
    "deep blocks": HEAD + "".join(" " * i + "a:\n" for i in range(3_000)),
    "deep dashes": HEAD + "x:\n " + "- " * 10_000 + "1\n",
    "billion laughs": HEAD
    + "a0: &a0 lol\n"
    + "".join(f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12)),
    "itself": HEAD + "gestures: &a {g: *a}\n",
    "python tag": HEAD + "title: !!python/object/apply:os.system ['touch pwned']\n",
    "python name": HEAD + "title: !!python/name:os.system\n",
    "local tag": HEAD + "title: !foo bar\n",
    "bytes": bytes(range(256)) * 64,
    "null bytes": b"ergon: 1\x00\ntitle: a\x00b\n",
    "only nulls": b"\x00" * 100_000,
    "UTF-16": "ergon: 1\n".encode("utf-16"),
    "UTF-16 without a mark": "ergon: 1\n".encode("utf-16-le"),
    "UTF-32": "ergon: 1\n".encode("utf-32"),
    "100 MB of spaces": lambda: b" " * 100_000_000,
    "60 MB of spaces": lambda: b" " * 60_000_000,
    "60 MB of lines": lambda: b"\n" * 60_000_000,
    "60 MB of comments": lambda: b"# x\n" * 15_000_000,
    "an open quote": lambda: b'title: "' + b"x" * 20_000_000,
    "a long name": lambda: b"x" * 20_000_000 + b": 1\n",
    "many anchors": HEAD + "".join(f"a{i}: &a{i} 1\n" for i in range(50_000)),
    "two documents": HEAD + "---\n" * 10,
    "nothing": b"",
    "a list": "- 1\n",
    "a word": "hello\n",
    "tabs": "ergon: 1\n\tkeys: {}\n",
}

NUMBERS = {
    **{f"M {v}": module(f"{{MAS: {{M: {v}}}}}") for v in (*NOT_NUMBERS, "-1g", "0", "1e-400")},
    **{f"K {v}": module(f"{{CEL: {{M: 1g, K: {v}}}}}") for v in (*NOT_NUMBERS, "-1")},
    **{f"f {v}": module(f"{{CEL: {{M: 1g, f: {v}}}}}") for v in (*NOT_NUMBERS, "-1", "0")},
    **{f"t60 {v}": module(f"{{CEL: {{M: 1g, f: 9, t60: {v}}}}}") for v in (*NOT_NUMBERS, "-1s")},
    **{f"X0 {v}": module(f"{{CEL: {{M: 1g, K: 1, X0: {v}}}}}") for v in NOT_NUMBERS},
    **{f"gap {v}": piece("gap: 1mm", f"gap: {v}") for v in NOT_NUMBERS},
    **{f"reach {v}": piece("M: 400g", f"M: 400g, reach: {v}") for v in (*NOT_NUMBERS, "0", "-1")},
    **{f"rate {v}": HEAD + f"rates: {{audio: {v}}}\n" for v in (*NOT_NUMBERS, "0", "-1", "1e12")},
    **{f"tail {v}": HEAD + f"render: {{tail: {v}}}\n" for v in (*NOT_NUMBERS, "-1s", "1e12s")},
    **{f"gain {v}": HEAD + f"mix: {{master: {{gain: {v}}}}}\n" for v in NOT_NUMBERS},
    **{
        f"seed {v}": HEAD + f"seed: {v}\n"
        for v in (*NOT_NUMBERS, "-1", "1e40", "1" * 40, "9" * 100_000)
    },
    "channels": HEAD + "mix: {channels: 1e9}\n",
}

SIZES = {
    "bank of 1e11": generator("BANK: {count: 1e11, M: 1g, f: 20Hz..1kHz, t60: 1s}"),
    "bank of 100000000000": generator("BANK: {count: 100000000000, M: 1g, f: 1kHz, t60: 1s}"),
    "bank of -5": generator("BANK: {count: -5, M: 1g, f: 20Hz..1kHz, t60: 1s}"),
    "three banks": HEAD
    + "instruments:\n"
    + "".join(
        f"  b{i}: {{BANK: {{count: 2000000, M: 1g, f: 20Hz..1kHz, t60: 1s}}}}\n" for i in range(3)
    ),
    "plate of 1e9": generator("PLATE: {shape: hex, radius: 1000000000, f: 50Hz, M: 1kg}"),
    "no string": generator("STRING: {masses: 0, f: 50Hz, M: 1kg}"),
    "stiff string": generator("STRING: {masses: 100000, f: 50Hz, M: 1kg, stiffness: 0.5}"),
    "rain of 1e12": strikes("for: 10s, rate: 1e12Hz"),
    "rain of 10 million": strikes("for: 1000s, rate: 99Hz"),
    "endless rain": strikes("for: 1e12, rate: 1Hz"),
    "hail without end": strikes("every: 0, times: 10"),
    "dense hail": strikes("every: 1e-9, until: 1000"),
    "members": strikes("for: 1, rate: 1Hz").replace("to: sky.all", "to: sky.0..99999999999"),
    "members backwards": strikes("for: 1, rate: 1Hz").replace("to: sky.all", "to: sky.9..3"),
    "every 0": piece("play: g", "play: g, every: 0, until: 4"),
    "a million": piece("play: g", "play: g, every: 1/1000000, until: 1000000"),
    "times": piece("play: g", "play: g, every: 1, times: 1000000000"),
    "at 1e12": piece("at: 0", "at: 1e12"),
    "bar 1e12": piece("at: 0", "at: 1000000000000|1"),
    "11 days": piece("at: 0", "at: 1000000s"),
    "a chain of gestures": HEAD
    + "gestures:\n  a0: 0@0 1@1\n"
    + "".join(f"  a{i}: {{like: a{i - 1}}}\n" for i in range(1, 2_000)),
}

TEXTS = {
    "bpm 0": HEAD + "tempo: [{at: 1|1, bpm: 0}]\n",
    "bpm 1e300": HEAD + "tempo: [{at: 1|1, bpm: 1e300}]\n",
    "bpm -1": HEAD + "tempo: [{at: 1|1, bpm: -1}]\n",
    "ramp": HEAD + "tempo: [{at: 1|1, bpm: 1 -> 1e17, over: 1}]\n",
    "marks in a circle": HEAD + "marks: {A: B+1, B: A+1}\n",
    "gestures in a circle": HEAD + "gestures: {a: {like: b}, b: {like: a}}\n",
    **{
        text[:40]: gesture(text)
        for text in (
            "0mm@0 (1mm@1 0mm@2)*1000000000",
            "0mm@0 " + "(" * 10_000 + "1mm@1" + ")*2" * 10_000,
            "0@0 " + "(0@1 1@2)*99999 " * 20,
            "0@0 1@1e12",
            "0@0 1e12@1",
            "nan@0 1@1",
            "0@inf 1@1",
            "0@0 1@-1",
            "0@0 1@1/0",
            "0@0 throw 1@1e-9",
            "0@0 1@1000000s",
            "0@0 " + "1" * 100_000 + "@1",
            "0@0 hold " * 1_000,
        )
    },
    **{
        text[:40]: law(text)
        for text in (
            "__import__('os').system('touch pwned')",
            "open('pwned', 'w')",
            "exec('x')",
            "d.__class__",
            "().__class__.__bases__",
            "d[0]",
            "{d}",
            "lambda: d",
            "d if d else d",
            "d := 1",
            "where(d)",
            "d;d",
            "1e999*d",
            "1/0*d",
            "10**10**10*d",
            "nan*d",
            "(" * 100_000 + "d" + ")" * 100_000,
            "(" * 500 + "d" + ")" * 500,
            "-" * 1_900 + "d",
            "d" + "+d" * 100_000,
            "max(" * 300 + "d,d" + ")" * 300,
        )
    },
    "law of points": law("d").replace('law: "d"', "points: [[0, .nan], [1, 1]]"),
    "law of many points": law("d").replace(
        'law: "d"', "points: [" + ",".join(f"[{i}, {i}]" for i in range(20_000)) + "]"
    ),
}

PATHS = (
    "/dev/zero",
    "/dev/random",
    "/dev/stdin",
    "/proc/self/mem",
    "/etc/passwd",
    "fifo",
    "socket",
    "zero",
    "loop",
    "..",
    "/",
    "http://localhost/x.yaml",
    "a" * 900,
)
FILES = {
    **{f"use {path[:30]}": HEAD + f"use: ['{path}']\n" for path in PATHS},
    **{f"take {path[:30]}": take(path) for path in PATHS},
    **{f"csv {path[:30]}": take(f"{path}.csv") for path in ("fifo", "socket", "zero", "loop")},
    **{f"calib {path[:30]}": HEAD + f"keys: {{k: {{calib: '{path}'}}}}\n" for path in PATHS},
    **{f"layout {path[:30]}": HEAD + f"mix: {{layout: '{path}'}}\n" for path in PATHS},
}
