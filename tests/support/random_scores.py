"""Random scores: modules of every kind in one network, keys that play it, gestures, strikes."""

import random

LAWS = {
    "cubic": "k*d + q*d**3, k: 200N/m, q: 4e7N/m3",
    "soft": "k*tanh(d/w), k: 0.3N, w: 1mm",
    "bow": "f*v*exp(-(v/w)**2), f: 0.4N, w: 0.1m/s",
    "magnet": "-f/(1 + (d/w)**2), f: 0.05N, w: 3mm",
}
METHODS = ("", "{error: -40dB}", "{cents: 3}", "{error: -80dB, cpu: 5%}", "{method: ca}")


class Score:
    """One score of a seed: `text`, and the names of its gesture and its instrument."""

    gesture = "go"

    def __init__(self, seed: int, with_space: bool = False, with_proxies: bool = False) -> None:
        self.dice = random.Random(seed)
        self.matter = ""  # an instrument in space
        self.points: list[str] = []  # MATs that links may join
        self.moving: list[str] = []  # those that may be heard and struck
        self.modules: list[str] = []
        for _ in range(self.dice.randint(1, 4)):
            self.body(f"m{len(self.modules)}")
        if with_space:
            self.space()
        if with_proxies:
            self.proxies()
            self.following()
        for _ in range(self.dice.randint(0, 6)):
            self.link(f"l{len(self.modules)}")
        self.link("hand", first="k")
        if self.dice.random() < 0.3:
            self.drive()
        self.text = self.score()

    def by_ratio(self, low: float, high: float) -> str:
        return f"{low * (high / low) ** self.dice.random():.4g}"

    def body(self, name: str) -> None:
        """A mass, a cell, a point or a generator, hardening or not."""
        pitch = f"f: {self.by_ratio(60, 900)}Hz, t60: {self.by_ratio(0.2, 4)}s"
        mass = f"M: {self.by_ratio(1e-3, 0.3)}kg"
        hard = self.dice.choice(("", "", f", hardening: {self.by_ratio(1e4, 1e9)}N/m3"))
        count = self.dice.randint(1, 24)
        start = self.dice.choice(("", "", f", X0: {self.by_ratio(1e-5, 1e-3)}m", ", V0: 0.1m/s"))
        shape = self.dice.choice(("hex", "square"))
        rim = self.dice.choice(("free", "fixed"))
        radius = self.dice.randint(1, 4)
        ends = self.dice.choice(("fixed", "free", "left"))
        spread = self.dice.choice(("random", "even"))
        kinds = {
            "MAS": f"{mass}{start}",
            "CEL": f"{mass}, {pitch}{start}",
            "SOL": "",
            "STRING": f"masses: {count + 2}, {mass}, {pitch}, ends: {ends}{hard}{start}",
            "PLATE": f"shape: {shape}, radius: {radius}, rim: {rim}, {mass}, {pitch}{hard}{start}",
            "BANK": f"count: {count}, {mass}, f: 80Hz..3kHz, t60: 0.2s..3s, spread: {spread}",
        }
        kind = self.dice.choice(("CEL", *kinds))
        self.modules.append(f"{name}: {{{kind}: {{{kinds[kind]}}}}}")
        ports = {"STRING": [f"{name}.1", f"{name}.2"], "BANK": [f"{name}.{count - 1}"]}
        ports["PLATE"] = [f"{name}.centre", f"{name}.0"]
        single = ports.get(kind, [name])
        self.points += single
        self.moving += [] if kind == "SOL" else single

    def link(self, name: str, first: str = "") -> None:
        """Any link between two of the points, or between the key and one of them."""
        if not self.moving or len(self.points) + bool(first) < 2:
            self.modules.append(f"for_{name}: {{CEL: {{M: 20g, f: 220Hz, t60: 1s}}}}")
            self.points.append(f"for_{name}")
            self.moving.append(f"for_{name}")
        a = first or self.dice.choice(self.moving)
        rest = [point for point in (self.moving if first else self.points) if point != a]
        b = self.dice.choice(rest) if rest else self.moving[0]
        stiff = f"K: {self.by_ratio(1, 1e4)}N/m"
        damp = f"Z: {self.by_ratio(1e-3, 1)}Ns/m"
        gap = self.dice.choice(("0mm", "0.2mm"))
        law = self.dice.choice(tuple(LAWS))
        word = "damping" if law == "bow" else "law"
        contact = self.dice.choice(("plain", "exact"))
        kinds = {
            "RES": stiff,
            "FRO": damp,
            "REF": f"{stiff}, {damp}",
            "BUT": f"contact: {contact}, gap: {gap}, {stiff}, {damp}",
            "LNL": self.dice.choice(
                (f"{word}: {law}", "points: [[-1mm, -1N], [0mm, 0N], [1mm, 2N]]")
            ),
        }
        kind = "BUT" if first and self.dice.random() < 0.7 else self.dice.choice(tuple(kinds))
        self.modules.append(f"{name}: {{{kind}: {{between: [{a}, {b}], {kinds[kind]}}}}}")

    def space(self) -> None:
        """An instrument in space; links on one axis may join some of its coordinates."""
        axes = self.dice.choice((2, 3))

        def place() -> str:
            return f"[{', '.join(f'{self.dice.uniform(-5, 5):.3g}cm' for _ in range(axes))}]"

        stiff = f"K: {self.by_ratio(1, 1e3)}N/m, Z: {self.by_ratio(1e-3, 0.1)}Ns/m"
        tears = self.dice.choice(
            ("", ", breaks: 5mm", ", yields: 100mN", ", yields: 1N, breaks: 2mm")
        )
        lines = [f"ball: {{MAS: {{M: {self.by_ratio(1e-3, 0.1)}kg, X0: {place()}}}}}"]
        lines.append(f"nail: {{SOL: {{X0: {place()}}}}}")
        generator = self.dice.choice(
            (
                f"CHAIN: {{masses: 5, M: 10g, from: {place()}, to: {place()}, {stiff}{tears}}}",
                f"CLOTH: {{sides: [3, 2], M: 10g, at: {place()}, across: {place()}, "
                f"up: {place()}, {stiff}, shear: 5N/m{tears}}}",
                f"GRAINS: {{count: 9, M: 10g, from: {place()}, to: {place()}, scatter: 0.3}}",
            )
        )
        lines.append(f"net: {{{generator}}}")
        lines.append(f"s: {{REF: {{between: [ball, nail], {stiff}{tears}}}}}")
        lines.append(f"c: {{BUT: {{between: [ball, net.all], {stiff}, gap: 1cm}}}}")
        lines.append(
            f"a: {{ATTRACTION: {{between: [ball, net.1], {stiff.partition(',')[0]}, core: 2cm}}}}"
        )
        wall = self.dice.choice(
            ("side: inside, gap: 4cm", f"normal: {place().replace('cm', '')}, gap: -1cm")
        )
        lines.append(f"w: {{BUT: {{between: [nail, net.all], {stiff}, {wall}}}}}")
        lines.append(f"m: {{BUT: {{between: [net.all, net.all], {stiff}, gap: 8mm}}}}")
        bodies = [one for one in self.modules if "STRING" in one or "PLATE" in one]
        if bodies:
            source, middle = bodies[0].partition(":")[0], place().rpartition(",")[0]
            surface = f"of: thing.{source}.all, at: {middle}], across: 10cm"
            lines.append(f"skin: {{SURFACE: {{{surface}}}}}")
            lines.append(f"t: {{BUT: {{between: [net.all, skin.all], {stiff}, gap: 1cm}}}}")
        gravity = self.dice.choice(("", "    gravity: 9.81m/s2\n"))
        modules = "\n".join(f"      {line}" for line in lines)
        self.matter = f"  matter:\n    space: {axes}\n{gravity}    modules:\n{modules}\n"
        self.matter += "    out: {x: {SOX: ball.x}, y: {SOV: net.1.y}, m: {SOF: m}, w: {SOF: w}}\n"
        self.points += ["matter.ball.x", "matter.net.1.y"]

    def proxies(self) -> None:
        """Points between masses; links join them as they join others."""
        bodies = [one.partition(":")[0] for one in self.modules if "STRING" in one]
        shares = [self.dice.uniform(-0.5, 1.5) for _ in self.points]
        ways = [f"of: [{', '.join(self.points)}], shares: {[round(one, 3) for one in shares]}"]
        if bodies:
            position = self.dice.uniform(0, 2)
            self.modules.append(f"finger: {{MAS: {{M: 1g, V0: {self.by_ratio(0.1, 10)}m/s}}}}")
            ways.append(f"of: {bodies[0]}, at: {position:.3g}")
            ways.append(f"of: {bodies[0]}, follows: finger, span: 10cm, offset: 3mm")
        for number, method in enumerate(ways):
            self.modules.append(f"p{number}: {{PROXY: {{{method}}}}}")
            self.link(f"at_p{number}", first=f"p{number}")
        self.points += [f"p{number}" for number in range(len(ways))]

    def following(self) -> None:
        """Links and a mass whose values follow the position of something that moves."""
        self.modules.append(f"lead: {{MAS: {{M: 1g, V0: {self.by_ratio(1e-3, 1)}m/s}}}}")
        for number in range(self.dice.randint(1, 2)):
            ends = self.dice.sample([*self.moving, "lead"], 2) if self.moving else ["lead", "k"]
            goes = [
                f"of: {self.dice.choice((*self.moving, 'lead'))}, from: {self.by_ratio(*ends_of)}, "
                f"to: {self.by_ratio(*ends_of)}, span: {self.dice.choice(('5mm', '-2mm'))}"
                for ends_of in ((1, 1e3), (1e-3, 0.1))
            ]
            law = f'law: "s*d", damping: "r*v", follows: {{s: {{{goes[0]}}}, r: {{{goes[1]}}}}}'
            self.modules.append(f"by{number}: {{LNL: {{between: [{', '.join(ends)}], {law}}}}}")
        follows = "follows: {M: {of: lead, from: 2g, to: 30g, span: 1cm}}"
        self.modules.append(f"pan: {{MAS: {{M: 2g, {follows}}}}}")
        self.link("of_pan", first="pan")
        self.moving.append("pan")

    def drive(self) -> None:
        """A point moved by a file, or a force from a file."""
        to = self.dice.choice(self.moving)
        self.modules.append(f"drive: {{ENF: {{to: {to}, from: {self.by_ratio(1e-3, 1)}N}}}}")

    def score(self) -> str:
        modules = "\n".join(f"      {module}" for module in self.modules)
        laws = "\n".join(f"  {name}: {{law: {law}}}" for name, law in LAWS.items() if name != "bow")
        listened = ", ".join(
            f"o{i}: {{SOX: {point}}}" for i, point in enumerate(sorted({*self.moving[:3]}))
        )
        touch, ergons = self.dice.choice(
            (("open", "event"), ("open", "particle"), ("tracked", "event"))
        )
        method = self.dice.choice(METHODS)
        struck = self.dice.choice(self.moving)
        return (
            "ergon: 1\n"
            "seed: 7\n"
            "keys: {k: {M: 300g, K: 60N/m, Z: 1Ns/m}}\n"
            f"laws:\n{laws}\n  bow: {{damping: {LAWS['bow']}}}\n"
            f"instruments:\n  thing:\n    modules:\n{modules}\n    out: {{{listened}}}\n"
            f"{self.matter}"
            f"gestures:\n  go: {{notation: 0mm@0 smooth 4mm@40ms throw 0mm@90ms,"
            f" touch: {touch}, ergons: {ergons}}}\n"
            f"strikes: {{tap: {{to: thing.{struck}, at: 20ms, impulse: 1mNs}}}}\n"
            "players: {ada: {key: k}}\n"
            "parts: {ada: [{at: 1|1, play: go}]}\n"
            "render: {tail: 60ms}\n" + (f"accuracy: {method}\n" if method else "")
        )


def score(seed: int, with_space: bool = False, with_proxies: bool = False) -> str:
    """The text of one score."""
    return Score(seed, with_space, with_proxies).text
