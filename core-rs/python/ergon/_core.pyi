"""The compiled core: everything that turns values into samples.

Sizes: n_mat MATs, n_lia LIAs, n_out outputs, n_frames frames, n_channels loudspeakers.
SI units throughout: metres, seconds, kilograms, newtons, newton-seconds, joules, hertz.
"""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Literal, Self, final

import numpy as np
from numpy.typing import NDArray

__version__: str

_Floats = NDArray[np.float64]
# An axis of a device: (number, sign, zero, gain, range, most force).
_Axis = tuple[int, float, float, float, tuple[float, float], float]

class EngineError(ValueError):
    """A network, law or timeline that the engine will not run."""

    module: str | None  # as the composer wrote it, e.g. `bell.m`; or an argument, e.g. `trim`

class UnstableError(EngineError):
    """The scheme would diverge at this rate; `module` moves most."""

class UnsureError(EngineError):
    """An axis that did not show which way it goes."""

class LawError(EngineError):
    """A law that cannot be compiled; `offset` and `length` mark the characters."""

    offset: int
    length: int
    suggestion: str | None

class DivergedError(EngineError):
    """A part went non-finite while it ran; `frame` is the sample index."""

    frame: int

class StoppedError(Exception):
    """A computation was ended before it was done: it was late, or cancelled."""

    why: Literal["late", "cancelled"]

# --- work that can be ended ----------------------------------------------------------------------

@final
class Work:
    """A stretch of work of one thread, entered by `with`; it is entered once at a time.

    What the core computes within it, and `poll`, raise StoppedError `seconds` [s] after it was
    entered, or once it is cancelled. What was being changed is then in no defined state. In the
    main thread a signal's handler that raises ends what the core computes as well.
    """

    def __new__(cls, seconds: float | None = None) -> Self: ...
    def cancel(self) -> None:
        """End it, from any thread, also before it is entered."""
    def __enter__(self) -> Self: ...
    def __exit__(self, *how: object) -> None: ...

def poll() -> None:
    """Raise StoppedError if the work of this thread is to end: for long loops in Python."""

# --- arithmetic whose last bit does not depend on the machine -----------------------------------

def ln(x: float) -> float: ...
def exp(x: float) -> float: ...
def pow(x: float, y: float) -> float: ...
def decibels(level: float) -> float:
    """Ratio of amplitudes for a level [dB]."""

@final
class Chance:
    """PCG64 keyed by SHA-256 of (seed, kind, name, member, occurrence): no draw depends on another."""

    def __new__(cls, seed: int, kind: str, name: str, member: int, occurrence: int) -> Self: ...
    def uniform(self, low: float, high: float) -> float: ...
    def logarithmic(self, low: float, high: float) -> float: ...
    def exponential(self, mean: float) -> float: ...

# --- what is ------------------------------------------------------------------------------------

@final
class Law:
    """An LNL law: `f = expression(d) + damping(d, v)`, or straight lines through `points`.

    `expression` and `damping` are texts of the law language (score reference, LNL); `constants`
    are SI numbers. With `reach` s the law is seen through a lever: f(d/s)/s.
    Raises LawError (`offset` counts characters of the text at fault; `LawError.args[1]` names it:
    "law" or "damping").
    """

    def __new__(
        cls,
        expression: str | None = None,
        damping: str | None = None,
        constants: Mapping[str, float] | None = None,
        points: Sequence[tuple[float, float]] | None = None,
        reach: float = 1.0,
    ) -> Self: ...
    def force(self, d: float, v: float = 0.0) -> float:
        """Force at elongation d [m] and its rate v [m/s]."""
    def forces(
        self,
        d: NDArray[np.float64],
        v: NDArray[np.float64],
        out: NDArray[np.float64],
        times: int = 1,
    ) -> None:
        """Forces [N] of a run of links at d [m] and v [m/s] into `out`, all (n_links,); `times` over."""
    def rows(self) -> list[tuple[str, int, int, int]] | None:
        """Its operations (name, operands: 0 is d, 1 v, 2 + i row i); None where it has none."""
    def native(self, address: int) -> Law:
        """The same law, computed by the native code of its rows at `address`."""
    def potential(self, d: float) -> float:
        """Energy stored at elongation d [J]; zero at d = 0."""
    def is_active(self, d_max: float, v_max: float) -> bool:
        """Whether damping·v < 0 somewhere in |d| <= d_max, |v| <= v_max: the link can give energy."""

def law_functions() -> list[tuple[str, int]]:
    """Addresses of the core's functions that native code of a law calls."""

@final
class Met:
    """The part of a scene that a hand can move, pressed: linear and at rest."""

    @property
    def others(self) -> int:
        """How many other hands feel it."""
    def key(self) -> bytes:
        """All that its answer is a function of: the same bytes, the same answer."""
    def response(self, every: int, ticks: tuple[int, int]) -> _Floats | None:
        """Force against the hand [N/m] in each tick of `every` frames after it was 1 m away for one
        (n_ticks,), at least and at most so many; None where the closed scene diverges by itself.
        Raises EngineError."""

@final
class Network:
    """What is: MATs and LIAs with SI parameters, grouped into named parts.

    Every adding method returns the index of the (first) module it made. Names are local: module
    `m` of part `bell` is reported as `bell.m`, member i of a generator as `bell.string.i`; a module
    whose name is "" bears the name of its part.
    """

    def __new__(cls) -> Self: ...
    n_mat: int
    n_lia: int
    n_out: int
    def part(self, name: str, *, ca_rate: float | None = None, every: int | None = None) -> None:
        """Start a part (an instrument, a key). With `ca_rate` its numbers are the algorithmic M, K,
        Z of the discrete network at that rate, which then is the truth (GENESIS habit). A plan lets
        its own springs pull once `every` so many frames, where it may (E4)."""
    def met(
        self,
        mat: int,
        rate: float,
        *,
        held: Sequence[int] = ...,
        without: Sequence[int] = ...,
        ties: Sequence[tuple[int, float, float, float]] = ...,
        factors: Sequence[tuple[int, float]] = ...,
        deep: float = ...,
    ) -> Met:
        """What a hand on a MAT can reach, at rest, with every contact closed and every law the
        stiffest spring that it is within `deep` [m]. `held`: MATs that other hands hold; `without`:
        LIAs that do not act; `ties`: (MAT, K, Z, M) and `factors`: (LIA, factor of its force) that
        differ from the network's own, in a glide. `rate` [Hz]. Raises EngineError."""
    def mas(self, name: str, *, M: float, X0: float = 0.0, V0: float = 0.0) -> int: ...
    def sol(self, name: str, *, X0: float = 0.0) -> int: ...
    def cel(
        self,
        name: str,
        *,
        M: float,
        K: float | None = None,
        Z: float | None = None,
        f: float | None = None,
        t60: float | None = None,
        X0: float = 0.0,
        V0: float = 0.0,
        rest: float = 0.0,
    ) -> int:
        """A MAS tied to the ground: by K [N/m] and Z [N·s/m], or by its damped frequency f [Hz] and
        decay t60 [s] (None: no decay)."""
    def string(
        self,
        name: str,
        *,
        masses: int,
        M: float,
        f: float,
        t60: float | None = None,
        ends: Literal["fixed", "free", "left"] = "fixed",
        stiffness: float = 0.0,
        hardening: float = 0.0,
    ) -> int:
        """`masses` MAS in a row, whole mass M [kg], tuned so that the lowest non-rigid mode is f."""
    def plate(
        self,
        name: str,
        *,
        shape: Literal["hex", "square"],
        radius: int,
        M: float,
        f: float,
        t60: float | None = None,
        rim: Literal["free", "fixed"] = "free",
        hardening: float = 0.0,
    ) -> int:
        """A mesh: `hex` of `radius` rings round its centre, or `square` of 2·radius+1 masses a side."""
    def bank(
        self,
        name: str,
        *,
        count: int,
        M: float,
        f: tuple[float, float],
        t60: tuple[float, float],
        spread: Literal["random", "even"] = "even",
        place: Literal["line", "spiral"] = "line",
        seed: int = 0,
    ) -> int:
        """`count` CELs, f over [low, high] (by logarithm), t60 from low f's (second) to high f's
        (first) when even, drawn when random."""
    def count(self, first: int) -> int:
        """How many MATs the module that begins at index `first` has (1, or a generator's)."""
    def centre(self, first: int) -> int:
        """Index of the middle MAT of the module that begins at `first`."""
    def start(self, index: int, X0: float, V0: float) -> None:
        """Set the initial position [m] and velocity [m/s] of one MAT."""
    def position_of(self, index: int) -> tuple[float, float]:
        """Where the MAT lies on the bench, (x, y) in metres (for pictures and `nearest`)."""
    def ref(
        self, name: str, a: int, b: int, *, K: float = 0.0, Z: float = 0.0, rest: float = 0.0
    ) -> int:
        """Spring and damper between MATs a and b (RES: Z = 0, FRO: K = 0). Returns the LIA index."""
    def but(
        self,
        name: str,
        a: int,
        b: int,
        *,
        K: float = 0.0,
        Z: float = 0.0,
        gap: float = 0.0,
        side: Literal["below", "above"] = "below",
        contact: Literal["plain", "exact", "magic"] = "plain",
        restitution: float = 1.0,
        exponent: float = 1.0,
        clamp: bool = False,
        steps: int = 2,
    ) -> int:
        """One-sided contact of the striker a on b. `magic` chooses K and Z itself from
        `restitution` and the number of `steps` a contact lasts."""
    def lnl(self, name: str, a: int, b: int, law: Law, *, rest: float = 0.0) -> int: ...
    def laws(self) -> list[tuple[list[tuple[str, int, int, int]], int, int]]:
        """Rows of every different law, its links alone in a run, its links in longer runs."""
    def native(self, entries: Sequence[tuple[int, int]]) -> None:
        """Compute `laws()[index]` by native code at address, for each (index, address)."""
    def impose(self, index: int) -> None:
        """The MAT's position is imposed (ENX): the timeline's `drive` says where it goes."""
    def listen(
        self,
        name: str,
        *,
        positions: Sequence[tuple[int, int, float]] = ...,
        forces: Sequence[tuple[int, int, float]] = ...,
        ground_forces: Sequence[tuple[int, int, float]] = ...,
    ) -> int:
        """An output: the sum of weight · (position of MATs / force of LIAs on their second point /
        K·(x-rest) of CELs) over ranges (first, count, weight). Returns the output's index."""
    def name_of(self, index: int) -> str:
        """A MAT as the composer wrote it, e.g. `gong.12`."""
    def certify(self, rate: float) -> Certificate:
        """Whether the CA scheme is stable at `rate`. Raises UnstableError, naming the module."""
    def modes(self, part: str, n_modes: int) -> list[tuple[float, float]]:
        """Lowest modes of a linear part as (f [Hz], t60 [s]) of the continuous network."""

@final
class Certificate:
    """λmax(M⁻¹(K+2Z)) < 4 (Jury; every BUT closed, every LNL at its slope at rest)."""

    lambda_max: float
    method: Literal["gershgorin", "dense", "lanczos"]
    word: Literal["proved", "guarded", "tried"]
    oversampling: int  # ceil(sqrt(λmax/4)): 1 when stable

@final
class Take:
    """A captured movement: the natural quintic spline through samples (t [s], x [m]), both (n,).

    `trim` keeps t in [from, to] and calls `from` zero; `smooth` is a 4th-order Butterworth low-pass
    [Hz], forward and back. t must rise; everything finite; at most 20,000,000 samples.
    """

    def __new__(
        cls,
        t: _Floats,
        x: _Floats,
        *,
        trim: tuple[float, float] | None = None,
        smooth: float | None = None,
    ) -> Self: ...
    duration: float
    def part(self, first: float, last: float) -> Take:
        """What lies between two instants [s], counted from its first one; raises EngineError."""
    def at(self, t: float) -> tuple[float, float, float]:
        """Position, velocity, acceleration at t [s]."""
    def positions(self, t: _Floats) -> _Floats:
        """Positions [m] at t [s], both (n,); quickest where instants follow each other closely."""

@final
class Recording:
    """What live hands did, tick by tick; sizes: n_ticks rows, n_axes axes.

    `rate` [Hz] is of the sound and a tick lasts `frames` frames: row k was consumed at frame
    ticks[k]·frames. Axes are (player, key); `about` is JSON by whoever recorded. Made here, forces
    and flags are zero. Raises EngineError where ticks do not rise or positions are not
    (n_ticks, n_axes).
    """

    def __new__(
        cls,
        rate: float,
        frames: int,
        axes: Sequence[tuple[str, str]],
        about: str,
        ticks: NDArray[np.uint64],
        positions: _Floats,
    ) -> Self: ...
    rate: float
    frames: int
    axes: list[tuple[str, str]]
    names: list[str]  # of each axis, one that no other has
    about: str
    events: list[tuple[int, str]]  # tick, JSON line
    duration: float  # from the first tick to the end of the last [s]
    dropped: int  # rows and events that found no room while recording
    lost_bytes: int
    whole: bool  # nothing of the file is lost
    finished: bool  # the recorder came to its end
    damage: str | None  # a sentence on what is wrong with the file, and what is left
    def ticks(self) -> NDArray[np.uint64]:
        """Rising, (n_ticks,)."""
    def positions(self) -> _Floats:
        """What the physics consumed [m], (n_ticks, n_axes)."""
    def forces(self) -> _Floats:
        """What the keys felt [N], (n_ticks, n_axes)."""
    def sent(self) -> NDArray[np.float32]:
        """What went to the devices, after safety [N], (n_ticks, n_axes)."""
    def flags(self) -> NDArray[np.uint8]:
        """1 fresh, 2 touch, 4 force enabled, 8 stand-in, 16 tripped, (n_ticks, n_axes)."""
    def clocks(self) -> NDArray[np.uint32]:
        """The devices' own clocks, as they send them, (n_ticks, n_axes)."""
    def held(self) -> _Floats:
        """Positions [m] at every tick from the first to the last, (n, n_axes), gaps held."""
    def to_bytes(self) -> bytes:
        """The bytes of a whole and finished `.take` file."""

def read_recording(path: str | PathLike[str], span: tuple[int, int] | None = None) -> Recording:
    """Read what is whole of a `.take` file; `span` keeps ticks from..to, counted from the first row.

    Raises EngineError where it is none, or longer than fits (20,000,000 rows · axes), and OSError.
    """

# --- what will happen ---------------------------------------------------------------------------

@final
class Timeline:
    """What will happen, by sample index. Build it after the Network is complete (it keeps a copy)."""

    def __new__(cls, network: Network, rate: float) -> Self: ...
    def open(self) -> None:
        """What else may come is not known (a session): no plan counts on what is written."""
    def key(self, name: str, struck: int) -> int:
        """A key: its part is copied as the free key that gestures are written for."""
    def gesture(
        self,
        key: int,
        t: Sequence[float],
        x: Sequence[float],
        curve: Sequence[Literal["smooth", "line", "hold", "throw"]],
        *,
        touch: Literal["open", "tracked"] = "open",
        ergons: Literal["event", "particle"] = "event",
        grain: float | None = None,
        join: float = 0.02,
        force_limit: float | None = None,
        layer: bool = False,
        sources: Sequence[int] = ...,
    ) -> int:
        """A narrative gesture: pass x[i] [m] at t[i] [s] of the piece; curve[i] is the way into
        point i (curve[0] is ignored). `sources[i]` is any number that comes back in the stream of
        ergons (a source place). Returns the gesture's index (reports come in that order)."""
    def ranges(self) -> list[tuple[float, float]]:
        """Lowest and highest position of each gesture's written points and paths [m], in order."""
    def take(
        self,
        key: int,
        take: Take,
        at: float,
        *,
        scale: float = 1.0,
        stretch: float = 1.0,
        reverse: bool = False,
        until: float | None = None,
        touch: Literal["open", "tracked"] = "open",
        ergons: Literal["event", "particle"] = "event",
        grain: float | None = None,
        join: float = 0.02,
        force_limit: float | None = None,
        layer: bool = False,
        source: int = 0,
    ) -> int:
        """A take played as a gesture from `at` [s]: x·scale at t·stretch."""
    def strike(
        self,
        mat: int,
        at: float,
        *,
        impulse: float | None = None,
        mass: float | None = None,
        speed: float | None = None,
        source: int = 0,
    ) -> None:
        """An ergon meets a MAT at `at` [s]: with an impulse [N·s], or a mass [kg] and speed [m/s]."""
    def rain(
        self,
        mats: Sequence[int],
        *,
        start: float,
        stop: float,
        rate: float,
        impulse: tuple[float, float],
        seed: int,
        name: str,
        source: int = 0,
        within: tuple[float, float] = ...,
    ) -> int:
        """Each MAT struck by a Poisson process of its own (rate [Hz], impulses drawn uniformly);
        member i draws from Chance(seed, "strikes", name, i, 0). What falls outside `within` [s] is
        drawn and does not strike. Returns the number of strikes."""
    def couple(
        self, link: int, start: float, stop: float | None = None, fade: float = 0.02
    ) -> None:
        """The LIA acts only from `start` to `stop` [s]: it fades in and out over `fade` [s]."""
    def fade(
        self, link: int, before: float, after: float, start: float, stop: float, *, n: int = 1
    ) -> None:
        """The force of `n` LIAs from `link` on, whole runs of them, is `before` times what it is
        until `start` [s] and `after` times from `stop` on, evenly between (on the grid of 64). For a
        spring that comes from another K and Z in one ratio: fade(link, K_old / K, 1, ...). What ends
        at 0 is no part of the key that gestures are written for. EngineError."""
    def glide(self, mat: int, k: float, z: float, m: float, start: float, stop: float) -> None:
        """A MAT has these K, Z and M until `start` [s] and the network's own from `stop` on,
        evenly between (on the grid of 64); it is stepped. EngineError."""
    def drive(
        self,
        mat: int,
        kind: Literal["position", "force"],
        *,
        constant: float | None = None,
        take: Take | None = None,
        at: float = 0.0,
        scale: float = 1.0,
        own: bool = True,
    ) -> None:
        """ENX / ENF: a constant, or a take from `at` [s] (before it its first value, after it its
        last). `own`: as a module of the MAT's own part, which a free key feels too."""
    def hand(
        self,
        mat: int,
        every: int,
        *,
        way: Literal["hold", "line"] = "line",
        positions: _Floats | None = None,
    ) -> int:
        """A real hand moves a MAT, in ticks of `every` frames; returns its index.

        `positions` (n_ticks,) [m]: what stands in for it, or was recorded of it. `way`: how it goes
        from one tick to the next.
        """

# --- what is computed ---------------------------------------------------------------------------

@final
class PlanRow:
    """What is computed together, and how, or what is not."""

    parts: list[str]
    n_mat: int  # MATs that move
    n_lia: int
    what: Literal[
        "stepped",
        "oscillators",
        "modes",
        "ca2p",
        "bm4",
        "ieq",
        "trapezoid",
        "e4",
        "unheard",
        "still",
    ]
    modes: tuple[int, int] | None  # computed, of how many
    left_out_db: float | None  # the other modes together, relative to all
    times: int  # how often a frame it is stepped
    steps: int  # how often a step contacts are computed while they may be closed
    error_db: float | None  # of the waveform, as a pilot measured it over
    error_s: float | None  # so many seconds from the start
    spectral_db: float | None  # chaotic after that: mean difference of third octaves
    cost: float  # seconds of work for a second of sound, by the table of costs
    word: Literal["proved", "guarded", "tried"] | None
    because: str | None  # why it is stepped
    every: int | None  # frames from one pull of its own springs to the next
    radius: float | None  # largest eigenvalue of what it and all it touches do from pull to pull
    preserved: bool  # slow, and not heard: at most -75 dB up to 10 frames, -70 dB up to 20
    offered: bool  # slow without being asked to be: so its island costs less
    stays: str | None  # parts that have a rate of their own and go at every frame, and why

@final
class Plan:
    """Network + Timeline + budget: no more than is heard and moved, each island by the cheapest
    method that is exact enough. Ask for a `method`, an error [dB] of the waveform, or `cents` up to a
    frequency [Hz]; for nothing, and it is planned by ear. EngineError where it cannot be."""

    def __new__(
        cls,
        network: Network,
        timeline: Timeline,
        *,
        method: Literal["ca", "modal", "ca2p", "bm4", "ieq", "trapezoid"] | None = None,
        error_db: float | None = None,
        cents: float | None = None,
        upto: float | None = None,
        pins: Sequence[tuple[int, int, int, Sequence[Sequence[int]]]] | None = None,
        told: Sequence[
            tuple[float | None, float | None, float | None, float | None, str | None]
        ]
        | None = None,
        like: Plan | None = None,
    ) -> Self:
        """`pins`: the `choices` of an earlier plan of the same score, to decide the same again;
        `told`: error_db, error_s, spectral_db, left_out_db and because of each of its rows, to say
        the same;
        `like`: a plan of another version: what it knows of bodies is not computed again."""

    @staticmethod
    def key(
        network: Network,
        timeline: Timeline,
        *,
        method: Literal["ca", "modal", "ca2p", "bm4", "ieq", "trapezoid"] | None = None,
        error_db: float | None = None,
        cents: float | None = None,
        upto: float | None = None,
    ) -> str:
        """A hash of all that a plan is a function of: 64 hex digits."""
    def rows(self) -> list[PlanRow]: ...
    def choices(self) -> list[tuple[int, int, int, list[list[int]]]]:
        """What was decided, island by island: (modules, times it is stepped a frame, how often a
        step contacts are computed, 0 for a bank; of each body its modes, or its method)."""
    def stay(self) -> list[tuple[str, str]]:
        """Parts that have a rate of their own and go at every frame all the same: (name, why)."""
    hash: str  # of what was decided: 64 hex digits

# --- what moves ---------------------------------------------------------------------------------

@final
class Report:
    """What became of one gesture, over the frames it ran."""

    gesture: int
    n_ergons: int
    start: float  # first and last instant it ran [s]
    stop: float
    worst: float  # largest |done - asked| on the loaded key [m], and when [s]
    worst_at: float
    pushed_by: str | None  # the MAT of another part that pushed most then
    compared: int  # frames compared
    rms: float  # [m]
    low: float  # excursion of the free key from the gesture's start to the next one's [m]
    high: float
    strongest: float  # largest velocity step of one ergon [m/s]
    force_max: float  # largest |force| of one ergon [N]
    missed: int  # steps that needed more than force_limit
    first_point_missed: bool  # it cut an earlier gesture and had to join after its start

@final
class Energy:
    """The ledger [J]: start + injected = stored + lost - produced + residual."""

    start: float
    stored: float
    injected: float
    lost: float
    produced: float
    residual: float
    flow: float  # Σ|injected|, |lost|, |produced| so far: what residual is compared with

@final
class Snapshot: ...

@final
class Simulation:
    """What plays: by a plan made from the same network and timeline, or every module as written. Then it
    can keep the ledger and the stream of ergons too."""

    def __new__(
        cls,
        network: Network,
        timeline: Timeline,
        *,
        plan: Plan | None = None,
        ledger: bool = False,
        record: bool = False,
        on_fault: Literal["stop", "mute"] = "stop",
        threads: int = 1,
        unchecked: bool = False,
        start: int = 0,
    ) -> Self:
        """`start`: the frame of its timeline that it begins at: what was due before is past, what
        moves begins at X0, or is taken over; `unchecked` runs even what the certificate refuses: to see where it really diverges."""
    rate: float
    frame: int
    n_out: int
    def process(self, out: _Floats) -> None:
        """Fill out (n_frames, n_out), C-contiguous, with the next frames. Raises DivergedError."""
    def positions(self) -> _Floats:
        """Positions now (n_mat,) [m]; NaN where the plan computes none."""
    def velocities(self) -> _Floats:
        """Backward differences now (n_mat,) [m/s]."""
    def asked(self) -> _Floats:
        """Where each key's gesture wants it now, NaN when none runs (n_keys,) [m]."""
    def hold(self, hand: int, x: float, step: float | None = None) -> None:
        """Say where a real hand is from the next tick on [m], and by what step it came there."""
    def felt(self, hand: int) -> float:
        """Mean force of the scene on a real hand over the last whole tick [N]."""
    def fork(self) -> Simulation:
        """The same at the same moment, to go its own way."""
    def damp(self, t60: float | None) -> None:
        """From this frame on let everything fade within t60 [s] where nothing else damps it (1/T60
        add up); None: no longer. Free copies of keys do not feel it."""
    def take_over(self, old: Simulation) -> list[int | None]:
        """Go on where `old` stands, which is of no use afterwards: what both have, by name, goes on,
        to the last bit where its network is the same. Which output here each of its outputs has
        become. EngineError unless both are at one frame."""
    def snapshot(self) -> Snapshot: ...
    def restore(self, snapshot: Snapshot) -> None: ...
    def energy(self) -> Energy:
        """The ledger; EngineError unless built with ledger=True."""
    def reports(self) -> list[Report]: ...
    def ergons(self) -> dict[str, NDArray[np.float64]]:
        """Ergons since the last call (built with record=True): columns `time` [s], `mat`, `mass`
        [kg], `speed` [m/s], `impulse` [N·s], `source`, each (n_ergons,)."""
    def muted(self) -> list[tuple[str, int]]:
        """Parts put to silence (name, frame) under on_fault="mute"."""
    def finer(self) -> list[tuple[str, int, int]]:
        """Parts whose links stiffened so far that frames were computed finer (name, frames, steps
        a frame at most)."""

# --- from outputs to loudspeakers ---------------------------------------------------------------

@final
class Mixer:
    """Routes of outputs to channels, with gains and second-order high-passes."""

    def __new__(cls, rate: float, n_out: int, n_channels: int) -> Self: ...
    def route(
        self,
        out: int,
        channel: int,
        gain: float = 1.0,
        highpass: float | None = None,
        group: int = 0,
    ) -> None:
        """Add gain · output to a channel (from 0); highpass [Hz] is a Butterworth of order 2.

        The gain of a group of routes may be moved while they sound.
        """
    def set_gain(self, group: int, gain: float) -> None:
        """Let the gain of a group glide to another, 20 ms from the next multiple of 64 frames on."""
    def take_over(self, old: Mixer, outputs: Sequence[int | None] | None = None) -> None:
        """Go on as `old` stands, with its gains and filters; `outputs`: which output here each of
        its outputs has become, where they are not the same."""
    def process(self, frames: _Floats, mixed: _Floats) -> None:
        """(n_frames, n_out) -> (n_frames, n_channels)."""

@final
class Limiter:
    """Look-ahead limiter: 5 ms ahead, 50 ms release, sample peak; all channels by one gain."""

    def __new__(cls, rate: float, n_channels: int, ceiling: float) -> Self: ...
    latency: int
    def process(self, frames: _Floats) -> None:
        """In place, (n_frames, n_channels); what comes out is `latency` frames late."""

@final
class Meter:
    """Peak and integrated loudness (ITU-R BS.1770) of what passes."""

    def __new__(cls, rate: float, n_channels: int) -> Self: ...
    def process(self, frames: _Floats) -> None: ...
    peak: float
    loudness: float  # LUFS; -inf for silence

def pcm(frames: _Floats, gain: float, bits: Literal[16, 24]) -> NDArray[np.int32]:
    """frames · gain as integers in the top bits of an int32, rounded half to even, clipped."""

def single(frames: _Floats, gain: float) -> NDArray[np.float32]:
    """frames · gain in single precision."""

# --- sound cards ----------------------------------------------------------------------------------

@final
class AudioOut:
    """An output: `auto`, `jack[:PORTS]`, `pulse[:SINK]`, `file:PATH`, `null`, `null:fast`."""

    def __new__(cls, spec: str, rate: int, n_channels: int, capacity: int = 4096) -> Self:
        """`capacity` frames of ring. Raises EngineError with what is not there."""
    room: int
    def set_prefill(self, n_frames: int) -> None:
        """Begin when so many frames wait, and begin again so after an underrun."""
    def push(self, frames: NDArray[np.float32]) -> int:
        """Give frames, (n_frames, n_channels), without waiting; how many were taken."""
    def play(self, frames: NDArray[np.float32]) -> None:
        """Give all frames, (n_frames, n_channels), waiting for room."""
    def finish(self, limit: float) -> bool:
        """No more will come: wait until all was heard; False when `limit` [s] came first."""
    def close(self) -> None:
        """Stop; a file is finished and gets its name. Raises EngineError when it could not be."""
    def panic(self) -> None:
        """Silence within 5 ms, until `release`."""
    def release(self) -> None:
        """Sound again, faded in."""
    info: tuple[str, str, int, int, float, str]
    """(backend, device, rate [Hz], block [frames], latency [s], the whole as a sentence)."""
    events: list[tuple[float, int, str]]
    """What happened: (when [s], frame, sentence) each."""
    alive: bool
    freewheeling: bool
    underruns: int
    missing: int  # frames of silence that underruns put in
    played: int  # frames of the score that went to the card
    discarded: int  # frames that a panic threw away
    xruns: int  # late cycles that the server told of

@final
class JackCapture:
    """A JACK client that records what another one sends, at most `n_frames` frames."""

    def __new__(cls, name: str, n_channels: int, n_frames: int) -> Self: ...
    recorded: int
    def connect(self, source: str, limit: float) -> bool:
        """Connect to the outputs of a client, waiting up to `limit` [s]; whether all are."""
    def freewheel(self, on: bool) -> bool:
        """Let the server run as fast as its clients do, or by its clock again."""
    def finish(self) -> NDArray[np.float32]:
        """End; the frames, (n_frames, n_channels)."""

def play_frames(frames: NDArray[np.float32], rate: int, spec: str = "auto") -> str:
    """Play frames, (n_frames, n_channels), at `rate` [Hz] to their end; says where."""

def survey_audio() -> list[tuple[str, bool, str]]:
    """(backend, whether it is there, what it is or why not) each; starts no server."""

# --- live ---------------------------------------------------------------------------------------

@final
class HandStatus:
    """How a real hand does: position [m], force felt and force sent [N], the part of the scene's
    force that it may get now (0 to 1)."""

    position: float
    force: float
    sent: float
    scale: float
    real: bool
    touch: bool
    enabled: bool
    tripped: bool

@final
class Status:
    """How a performance goes. `load` and `busiest` are parts of a tick, `latest` is in seconds.

    `sounding` [s]: since the first frame went to the card, by what its last block tells (frame n
    goes n frames later; None before that); `latency` [s]: from there to being heard.
    """

    frame: int
    ticks: int
    late: int
    latest: float
    lost: int
    dropped: int
    missed: int
    load: float
    busiest: float
    filled: int
    underruns: int
    played: int
    alive: bool
    sounding: float | None
    latency: float
    paced: bool
    peaks: list[float]
    hands: list[HandStatus]

@final
class Performance:
    """A piece that is being played: one real-time thread, keys on one side, sound on the other."""

    def __new__(
        cls,
        simulation: Simulation,
        mixer: Mixer,
        *,
        every: int = 64,
        audio: str = "auto",
        gain: float = 1.0,
        limit: float = 1.0,
        n_frames: int | None = None,
        hands: Sequence[tuple[_Floats, float, tuple[float, float, bool] | None, _Floats]] = ...,
        boards: Sequence[tuple[str, Sequence[tuple[int, int]], float | None, Sequence[_Axis]]] = ...,
        bars: Sequence[int] = ...,
        ahead: int | None = None,
        record: tuple[Path, Sequence[tuple[str, str]], str] | None = None,
        frozen: Sequence[tuple[Path, int, int, Sequence[int]]] = ...,
    ) -> Self:
        """Begin. `hands`: (positions at each tick (n_ticks,) [m], reach, (K, Z, is loose)
        that guide it, the scene's force in each tick after it was 1 m away for one [N/m]); a loose
        guide begins let go;
        `boards`: (url, (axis, hand) of each hand on it, most force [N], what was found of its
        axes); `bars`: frames at which a hand that comes back takes over; `record`: (file, (player,
        key) of each hand, JSON about it); `frozen`: (file, bytes before its doubles, frames,
        outputs) of parts that were computed before. Raises EngineError."""
    def status(self) -> Status: ...
    def events(self) -> list[tuple[int, str, float]]:
        """What happened since the last call: (frame, what, number of the hand or board)."""
    def sound_events(self) -> list[tuple[float, str]]:
        """What happened to the sound: (seconds, sentence)."""
    def bears(self, hand: int, response: _Floats) -> tuple[float, float, float] | None:
        """What the key under a real hand bears of a scene that answers it so (n_ticks,) [N/m]: part
        of the force, stiffness met and borne [N/m]; None where the hand is not real."""
    def borne(self) -> list[tuple[int, float, float, float]]:
        """How much of the scene's force each real hand gets: (hand, part of it, stiffness met
        [N/m], stiffness borne [N/m])."""
    def output(self) -> str:
        """What it plays on, in words."""
    def granted(self) -> str | None:
        """What the system granted the physics thread; None until it runs."""
    def panic(self) -> None:
        """Silence within 5 ms and zero force at the next tick."""
    def release(self) -> None:
        """Sound and force again, after a panic or after `let_go`."""
    def gain(self, gain: float) -> bool:
        """Go to another gain in 20 ms; False where too much is asked at once."""
    def part_gain(self, group: int, gain: float) -> bool:
        """Another gain of one of the mixer's groups of routes, in the same way."""
    def change(
        self,
        at: int,
        *,
        simulation: Simulation | None = None,
        old: Simulation | None = None,
        mixer: Mixer | None = None,
        gains: Sequence[tuple[int, float]] = ...,
        gain: float | None = None,
        bars: Sequence[int] | None = None,
        standins: Sequence[_Floats] | None = None,
        leads: Sequence[Sequence[tuple[int, float, float]]] | None = None,
        bounds: Sequence[Sequence[tuple[int, float]]] | None = None,
        damp: float | None = None,
    ) -> int:
        """Change what is said at frame `at`, the first of a tick. Returns a ticket, which an event
        "changed" tells, or "late" where that frame had passed, or another plan than `old` has plays
        there: nothing is changed then. `simulation` (its `start` is `at`) takes over from `old`, one
        by the very Plan that plays until then, at any moment; `mixer` goes on with the gains and filters of the one before;
        `standins`: where each hand stands in at each tick from this one on (n_ticks,) [m], without
        any as before; `leads`: of each hand's loose guide, after how many ticks which shares of its
        K and Z act (0 to 1); `bounds`: of each hand, after how many ticks how much of the scene's
        force it may get (0 to 1), which falls to that beforehand and rises to it afterwards; without any as before; `damp`: as Simulation.damp, 0 for no longer (a take-over ends it too).
        Raises EngineError."""
    def stop(self) -> None:
        """Play nothing more."""
    def wait(self, seconds: float) -> bool:
        """Wait until the last frame is computed; False when `seconds` came first."""
    def recording_trouble(self) -> str | None:
        """Why the recording cannot be written at present; None where it can, or there is none."""
    def close(self, patience: float) -> list[tuple[int, str, float]]:
        """Wait until everything was heard, put everything away; the events that are left."""

# --- devices ------------------------------------------------------------------------------------

def stop_on_signals(signals: Sequence[int], *, ends: bool | None) -> None:
    """Have signals stop something at once, below Python, before their handlers run: where the
    program `ends` every force and sound, else every force; None: nothing. Ask again whenever a
    handler was set: that takes the signal over."""

def let_go() -> None:
    """No force on any hand, until a performance is released."""

def has_let_go() -> bool:
    """Whether every hand is let go, by `let_go` or by a signal."""

def begin_again() -> None:
    """Nothing is stopped: for a process that outlives what a signal ended."""

def emulate(
    protocol: Literal["firefader", "frame", "haply"],
    transport: Literal["pty", "udp", "ws"],
    tell: Callable[[str, str], object],
    *,
    port: int = 0,
    paths: Sequence[_Floats],
    hand: tuple[float, float],
    axes: int,
    mass: float,
    stiffness: float,
    damping: float,
    travel: float,
    force_max: float,
    resolution: float,
    rate: float,
    lockstep: bool,
    touch_gate: bool,
    watchdog: float,
    seconds: float | None = None,
    once: bool = False,
) -> None:
    """Be a device of `axes` keys (mass [kg], stiffness [N/m], damping [Ns/m], travel [m], motors of
    force_max [N], a sensor's resolution [m]) at rate [Hz], until Ctrl-C or `seconds`, heard on 127.0.0.1 alone.

    Hands of stiffness [N/m] and damping [Ns/m] `hand` go `paths`, each (n,) [m] by period; an empty
    one is a resting finger, a missing one none. `tell(event, what)` hears: ready and the address,
    let-go (silence of the host for `watchdog` [s]), host-gone, and over with periods, packets and the
    hash of all positions.
    """

def guard_haply() -> None:
    """Be the guardian of a Haply: hold the connection to its service and take forces back where the
    host is silent, stopped or gone. The host is at the other end of the standard input; returns when it is
    gone. For a process that does nothing else. Raises EngineError where no host is there."""

def serial_ports() -> list[tuple[str, tuple[int, int, str, str] | None]]:
    """(path, (vendor, product, name, serial number) of what came by USB) each; opens none."""

def serial_identity(path: str) -> str | None:
    """What the board on a serial port is called wherever it is plugged in; None where unsure."""

def checkup(seconds: float, period: float) -> Checkup:
    """Wake like the physics thread for so many seconds, a period [s] apart."""

@final
class Device:
    """A device that is open, to be looked at and tried. Raises EngineError where it is not there."""

    def __new__(cls, url: str, calibration: Sequence[_Axis] = ...) -> Self: ...
    axes: int
    unit: str  # of positions, m or rad
    resolution: float  # step of the position sensor [m or rad]
    range: tuple[float, float]  # [m or rad]
    force_max: float  # [N or N·m]
    lockstep: bool
    def direction(self, axis: int, period: float) -> float:
        """Which way an axis goes when it is pushed a little: 1 or -1. Raises UnsureError."""
    def ends(self, seconds: float, period: float) -> _Floats:
        """Least and greatest position of each axis while somebody moves it, (n_axes, 2)."""
    def checkup(self, seconds: float, period: float) -> Checkup:
        """Send zero forces, a period [s] apart, and time the replies."""
    def close(self) -> None: ...

@final
class Checkup:
    """What a checkup found; `unanswered`: forces without a reply within 20 ms."""

    priority: int | None  # under SCHED_FIFO; None: scheduled like any other
    locked: bool  # memory stays in RAM
    seconds: float
    unanswered: int
    garbage: int  # bytes that belonged to no packet
    drift_ppm: float | None  # how much faster the device's clock goes [1e-6]
    def lateness(self) -> _Floats:
        """How late each tick began, (n_ticks,) [s]; none in lockstep."""
    def round_trips(self) -> _Floats:
        """From each force to its reply, (n_replies,) [s]."""
