"""The compiled core: everything that turns values into samples.

Sizes: n_mat MATs, n_lia LIAs, n_out outputs, n_frames frames, n_channels loudspeakers. SI units
throughout: metres, seconds, kilograms, newtons, newton-seconds, joules, hertz.

A long computation raises StoppedError if the limit of a `Work` is reached, and whatever a
signal's handler raises. An array of the wrong shape or type raises TypeError or ValueError, an
index that does not exist EngineError.
"""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Literal, NamedTuple, Protocol, Self, final, type_check_only

import numpy as np
from numpy.typing import NDArray

__version__: str
FADE: float  # couplings fade in and out over this time [s]
GRID: int  # changes that a plan must foresee begin at multiples of this many frames
FORCE_FALL_TIME: float  # the force begins to fall this long before a stiffer piece acts [s]
FORCE_SCALE_MIN: float  # smallest factor of the piece's force that a hand may get (0 to 1)
INAUDIBLE_ERROR_DB: float  # the error of a waveform that counts as none by ear [dB]
# Errors that count as equal by ear, in the order of AudibleError.
JUST_NOTICEABLE: tuple[float, float, float, float, float, float]
MAX_MODAL: int  # most modes of a MODES
MAX_PLACES: int  # most places of a MODES
# Mean difference of third octaves that rounding alone causes in a chaotic motion [dB].
SPECTRUM_NOISE_DB: float

_Floats = NDArray[np.float64]
_LinkFactor = tuple[int, float]  # (LIA, factor of its force)
_NativeLaw = tuple[int, int]  # (index in Network.laws(), address of its machine code)

class Range(NamedTuple):
    """Lowest and highest of some positions, [m] or [rad]."""

    low: float
    high: float

class Impulse(NamedTuple):
    """Impulse of a strike on a MAT [N·s], and its time [s]."""

    at: float
    impulse: float

class EngineError(ValueError):
    """An argument, network, law or timeline that the core refuses."""

    module: str | None  # as written in the score, e.g. `bell.m`; or an argument, e.g. `trim`
    index: int | None  # the point of a gesture, or the hand, that is at fault, from 0
    sentence: str  # what is wrong, without the module
    refusals: list[EngineError]  # one for each module, if several are refused; else empty

class UnstableError(EngineError):
    """The scheme would diverge at this rate; `module` moves most in the unstable mode."""

class UnsureError(EngineError):
    """The direction of an axis could not be found."""

class LawError(EngineError):
    """A law that cannot be compiled; `offset` and `length` mark the characters."""

    offset: int
    length: int
    suggestion: str | None

class DivergedError(EngineError):
    """A part became non-finite while it ran; `frame` is the sample index."""

    frame: int

class StoppedError(Exception):
    """A computation was stopped: it is above its limit of steps (costly), or it was cancelled."""

    why: Literal["costly", "cancelled"]

# --- work that can be ended ----------------------------------------------------------------------

@final
class Work:
    """A limit for the computations of one thread, a context manager.

    Within it the computations of the core, and `poll`, raise StoppedError after a number of `steps`
    (None: no limit), or once it is cancelled. A step is about a nanosecond of work on a machine of
    2024; steps are counted, so that the same work is stopped on every machine. An object that a
    stopped computation was changing is then in an undefined state. In the main thread an exception
    that a signal's handler raises stops computations as well.
    """

    def __new__(cls, steps: int | None = None) -> Self: ...
    def cancel(self) -> None:
        """Cancel the work, from any thread, also before it is entered."""
    def __enter__(self) -> Self:
        """Begin: steps are counted from here."""
    def __exit__(self, *how: object) -> None:
        """End: computations of this thread no longer stop for this limit."""

def poll(steps: int = 0) -> None:
    """Count steps of work in Python, and raise StoppedError if this thread is within a Work that
    ends; for long loops in Python, which Ctrl-C interrupts by itself.
    """

# --- arithmetic whose last bit does not depend on the machine -----------------------------------

def ln(x: float) -> float:
    """Natural logarithm."""

def exp(x: float) -> float:
    """e to the power x."""

def pow(x: float, y: float) -> float:
    """x to the power y."""

def sin(x: float) -> float:
    """Sine of an angle [rad]."""

def cos(x: float) -> float:
    """Cosine of an angle [rad]."""

def atan2(y: float, x: float) -> float:
    """Angle of the point (x, y) [rad]."""

def decibels(level: float) -> float:
    """Ratio of amplitudes for a level [dB]."""

def path_values(
    points: Sequence[tuple[float, float, Literal["smooth", "line", "hold"]]],
    instants: Sequence[float],
) -> list[float]:
    """Values at instants [s] of the path through points (t [s], x, the way to the point).

    The path is that of a written gesture. Raises EngineError if the times of the points do not
    rise.
    """

def key_path(
    parameters: _Floats,
    force: _Floats,
    rate: float,
    *,
    columns: Sequence[int] | None = None,
    steps: int | None = None,
) -> tuple[_Floats, _Floats]:
    """Path (n,) [m] of a real key under forces (n,) [N], and the derivatives of the path (n,
    columns).

    `rate` [Hz] is that of the ticks: force k is held for one tick from k/rate + delay on, and
    path k is the position at k/rate; the key begins at rest. `parameters` (10 + 3·modes,) are,
    in this order: mass [kg], stiffness [N/m], damping [N·s/m], weight [N] (a constant force
    towards negative positions), dry friction [N], start [m], delay [s], presliding stiffness
    [N/m] (zero: a resting key is held rigidly), static dry friction [N] and its speed [m/s]
    (zero: none), then for each mode mass [kg], frequency [Hz] and damping ratio. The first mass
    does not include the modes.

    `columns`: the indices of the parameters with respect to which the path is differentiated, at
    most 32; None: all. `steps`: steps of a tick; None: those of 44.1 kHz. Raises EngineError if
    the parameters are impossible, or if the key is too fast for its steps.
    """

def key_force_derivatives(
    parameters: _Floats,
    force: _Floats,
    rate: float,
    ticks: Sequence[int],
    *,
    steps: int | None = None,
) -> _Floats:
    """Derivatives [m/N] of the path of `key_path` with respect to the forces of some ticks, (n,
    ticks).

    `ticks` rise. Raises EngineError as `key_path` does, and for a tick that does not exist.
    """

@final
class Chance:
    """Random numbers: PCG64 keyed by SHA-256 of all arguments, so that no stream depends on
    another.
    """

    def __new__(cls, seed: int, kind: str, name: str, member: int, occurrence: int) -> Self: ...
    def uniform(self, low: float, high: float) -> float:
        """A number from low to high, uniformly. Raises EngineError unless both are finite."""
    def logarithmic(self, low: float, high: float) -> float:
        """A number from low to high whose logarithm is uniform.

        Raises EngineError unless both are finite and above zero.
        """
    def exponential(self, mean: float) -> float:
        """A number with an exponential distribution. Raises EngineError for a mean below zero."""

# --- what is ------------------------------------------------------------------------------------

class LawRow(NamedTuple):
    """An operation of a law and its operands: 0 is d, 1 is v, 2 + i is row i."""

    operation: str
    a: int
    b: int
    c: int

class LawUse(NamedTuple):
    """A law of a network: its rows, links with it alone in their run, and links in longer runs."""

    rows: list[LawRow]
    alone: int
    in_runs: int

class LawFunction(NamedTuple):
    """A function of the core that native code of a law calls."""

    name: str
    address: int

@final
class Law:
    """The law of an LNL: `f = expression(d) + damping(d, v)`, or straight lines through `points`.

    `expression` and `damping` are texts of the law language (score reference, LNL); `constants`
    are SI numbers; `points` are (d [m], f [N]). With `reach` s the law acts through a lever:
    f(d/s)/s. Raises LawError; its `offset` counts characters of the text at fault, which
    `LawError.args[1]` names: "law" or "damping".
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
        """Force [N] at elongation d [m] and its rate v [m/s]."""
    def forces(
        self,
        d: NDArray[np.float64],
        v: NDArray[np.float64],
        out: NDArray[np.float64],
        times: int = 1,
    ) -> None:
        """Write forces [N] for d [m] and v [m/s] into `out`, all (n_links,); computed `times`
        times.

        Raises ValueError if the lengths differ.
        """
    def rows(self) -> list[LawRow] | None:
        """The operations, in order; None for `points`."""
    def native(self, address: int) -> Law:
        """The same law, computed by native code of its rows at `address`.

        Raises ValueError if the law has no rows.
        """
    def potential(self, d: float) -> float:
        """Stored energy [J] at elongation d [m]; zero at d = 0."""
    def is_active(self, d_max: float, v_max: float) -> bool:
        """Whether the link can give energy: damping·v < 0 for some |d| <= d_max, |v| <= v_max."""

def law_functions() -> list[LawFunction]:
    """The functions of the core that native code of a law calls."""

class MatValues(NamedTuple):
    """K [N/m], Z [N·s/m] and M [kg] of a MAT at one moment of a glide."""

    mat: int
    K: float
    Z: float
    M: float

class ModuleRange(NamedTuple):
    """`n` modules from `first` on, in an output, and the weight of their sum."""

    first: int
    n: int
    weight: float

class Place(NamedTuple):
    """A place on the bench [m]."""

    x: float
    y: float

class LookRun(NamedTuple):
    """A run of points of one kind, and the name of their part.

    `why` is the reason why the points are not computed. For a modal part, `modes` are its first
    mode, how many modes are looked at, and how many are computed.
    """

    part: str
    first: int
    count: int  # type: ignore[assignment]
    kind: Literal["free", "sampled", "modal", "none"]
    why: Literal["unheard", "unmoved"] | None
    modes: tuple[int, int, int] | None

class LookContact(NamedTuple):
    """A link that opens and closes, and its two MATs."""

    name: str
    a: int
    b: int

class MotionChunk(NamedTuple):
    """A chunk of a motion file: its kind, its instant [s] and the bytes of its payload."""

    kind: int
    seconds: float
    size: int

class Mode(NamedTuple):
    """A mode of a part: damped frequency [Hz], and decay [s], infinite without loss."""

    f: float
    t60: float

class PartModes(NamedTuple):
    """Modes of a part, from low to high.

    `poles` (n_modes,) are s of e^(st) [1/s]; `shapes` (n_modes, n_masses) are the motions x of
    the masses, normalised by xᵀ(2sM + Z)x = 2i·Im s [kg^-1/2]; `mats` (n_masses,) are the
    indices of the masses. `is_certified`: the inertia of the stiffness matrix proves that no
    undamped mode is missing. `n_laws` links were taken at their slope at rest, `n_contacts` as
    open.
    """

    poles: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    mats: list[int]
    is_certified: bool
    n_laws: int
    n_contacts: int

class Elements(NamedTuple):
    """The masses and links of some parts by themselves, laws at their slope at rest.

    `mats` (n_masses,) are the indices of the masses, `masses` (n_masses,) are in kg. For each
    link, `kinds` (n_links,) is CEL (a tie to the ground), RES, FRO, REF, BUT, LNL, BRISTLE, DRY
    or SPACE, `a` and `b` (n_links,) are the slots of its ends among the masses, -1 for an end
    that is held, `stiffness` (n_links,) is in N/m and `damping` (n_links,) in N·s/m; those of a
    BUT hold while it is closed. `n_held` points are fixed or imposed. `ca_rate` [Hz] is the rate
    of a part with algorithmic values.
    """

    mats: list[int]
    masses: _Floats
    kinds: list[str]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    stiffness: _Floats
    damping: _Floats
    n_held: int
    ca_rate: float | None

@final
class ReachableNetwork:
    """The part of a network that a hand can move: linear, at rest, all contacts closed."""

    @property
    def others(self) -> int:
        """Number of other hands that feel this hand."""
    def key(self) -> bytes:
        """Bytes that determine `response`: equal bytes, equal response."""
    def response(self, tick_frames: int, ticks: tuple[int, int]) -> _Floats | None:
        """Force against the hand [N/m] in each tick after it was 1 m away for one tick, (n_ticks,).

        A tick has `tick_frames` frames; `ticks` are the least and the greatest n_ticks. None if
        the linear network diverges by itself. Raises EngineError.
        """

@final
class Network:
    """MATs and LIAs with SI parameters, grouped into named parts.

    Every adding method returns the index of the (first) module that it made, and raises
    EngineError for impossible numbers. Names are local: module `m` of part `bell` is reported as
    `bell.m`, member i of a generator as `bell.string.i`; a module named "" has the name of its
    part.
    """

    def __new__(cls) -> Self: ...
    n_mat: int
    n_lia: int
    n_out: int
    def part(
        self, name: str, *, ca_rate: float | None = None, macrostep: int | None = None
    ) -> None:
        """Start a part (an instrument, a key): modules added from now on belong to it.

        With `ca_rate` [Hz] its numbers are the algorithmic M, K, Z of the discrete network at
        that rate, as in GENESIS. With `macrostep` a plan may compute the part's own springs only
        once in this many frames (method E4). Raises EngineError.
        """
    def reachable_network(
        self,
        mat: int,
        rate: float,
        *,
        held: Sequence[int] = ...,
        without: Sequence[int] = ...,
        ties: Sequence[MatValues | tuple[int, float, float, float]] = ...,
        factors: Sequence[_LinkFactor] = ...,
        depth: float = ...,
    ) -> ReachableNetwork:
        """The part of the network that a hand on a MAT can move, at `rate` [Hz].

        The part is at rest, every contact is closed, and every law is replaced by the stiffest
        spring that it is within `depth` [m]. `held`: MATs that other hands hold; `without`: LIAs
        that do not act. `ties` and `factors` replace the network's own values during a glide.
        Raises EngineError.
        """
    def mas(self, name: str, *, M: float, X0: float = 0.0, V0: float = 0.0) -> int:
        """A free mass M [kg] that starts at X0 [m] with V0 [m/s]."""
    def sol(self, name: str, *, X0: float = 0.0) -> int:
        """A fixed point at X0 [m]."""
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
        """A mass M [kg] tied to the ground at `rest` [m], starting at X0 [m] with V0 [m/s].

        The tie has K [N/m] and Z [N·s/m], or is given by the damped frequency f [Hz] and the decay
        t60 [s] (None: no decay).
        """
    def follow_mass(
        self, name: str, index: int, by: tuple[int, float, float, float, float]
    ) -> None:
        """Let the mass of a MAS follow another MAT, as in `following_lnl`. Raises EngineError."""
    def proxy(self, name: str, shares: Sequence[tuple[int, float]]) -> int:
        """A massless point at the weighted sum of masses, each (index, share).

        A force on it is divided among them by the same shares. Raises EngineError.
        """
    def shares(self, index: int) -> list[tuple[int, float]]:
        """The masses of a proxy, each (index, share), with all MATs at their initial positions;
        empty for another MAT.
        """
    def moving_proxy(
        self,
        name: str,
        mats: Sequence[int],
        columns: int,
        along: tuple[tuple[int | None, float, float], tuple[int | None, float, float]],
    ) -> int:
        """A massless point on rows of MATs, linear between neighbours.

        `along` is its place among the rows and its place within a row, counted in MATs from the
        first. Each is either (None, place, 1.0), a fixed place, or (index, offset [m], span
        [m]): the point is (x + offset)/span of the way from the first to the last MAT, where x
        is the position of the MAT `index`. Raises EngineError.
        """
    def string(
        self,
        name: str,
        *,
        masses: int,
        M: float,
        f: float | None = None,
        t60: float | Sequence[tuple[float, float]] | None = None,
        K: float | None = None,
        Z: float | None = None,
        ends: Literal["fixed", "free", "left"] = "fixed",
        stiffness: float = 0.0,
        inharmonicity: float | None = None,
        hardening: float = 0.0,
        stretching: float = 0.0,
    ) -> int:
        """`masses` MAS in a row of total mass M [kg], whose lowest vibrating mode has f [Hz] and
        t60 [s].

        `t60` may also be pairs (f [Hz], t60 [s]) of two modes or more, which are met within 1 %.
        `K` and `Z` of each link may be given instead of `f` and `t60`. With `inharmonicity` B
        (instead of `stiffness`) the first 20 partials are f·n·√((1 + B·n²)/(1 + B)), within 1
        cent. `stretching` is q [N/m³] of a force q·S·d on every link, where S is the sum of the
        squares of all elongations d.
        """
    def plate(
        self,
        name: str,
        *,
        shape: Literal["hex", "square", "disc"] = "hex",
        radius: int = 0,
        sides: tuple[int, int] | None = None,
        M: float,
        f: float | None = None,
        t60: float | Sequence[tuple[float, float]] | None = None,
        K: float | None = None,
        Z: float | None = None,
        rim: Literal["free", "fixed"] = "free",
        bending: float | None = None,
        hardening: float = 0.0,
    ) -> int:
        """A mesh of total mass M [kg], whose lowest vibrating mode has f [Hz] and t60 [s].

        `hex` and `disc` have `radius` rings around the centre, `square` has 2·radius+1 masses a
        side, a rectangle has `sides` (across, up). With `bending`, Poisson's ratio, the plate
        resists curvature; its rim is free, or held at rest and free to turn. `t60` may also be
        pairs (f [Hz], t60 [s]) of two modes or more, which are met within 1 %. `K` and `Z` of
        each link may be given instead of `f` and `t60`.
        """
    def points(
        self,
        name: str,
        *,
        axes: int,
        M: Sequence[float],
        X0: Sequence[float],
        V0: Sequence[float],
        Z: float = 0.0,
        numbered: bool = True,
    ) -> int:
        """Points in space of mass M [kg] each, 0 for fixed ones; the index of the first MAT.

        X0 [m] and V0 [m/s] are (axes · n,), axis by axis, in the order of the MATs: the
        coordinate of point i along axis j is MAT first + j · n + i. `Z` [N·s/m] is the viscosity
        of the surroundings at each point. Coordinates are named NAME.3.x, or NAME.x for a single
        point that is not `numbered`. Raises EngineError.
        """
    def weigh(self, first: int, count: int, g: float) -> None:
        """Let gravity g [m/s²] act along the axis of `count` MATs from `first` on.

        Raises EngineError if g is not finite.
        """
    def distance(self, a: Sequence[int], b: Sequence[int]) -> float:
        """Distance [m] of two points in space at the beginning; each is the MATs of its axes."""
    def space_ref(
        self,
        name: str,
        a: Sequence[int],
        b: Sequence[int],
        *,
        rest: float,
        count: int = 1,
        K: float = 0.0,
        Z: float = 0.0,
        yields: float | None = None,
        breaks: float | None = None,
        core: float | None = None,
    ) -> int:
        """Springs K [N/m] and dampers Z [N·s/m] along the distance of points; the first LIA's
        index.

        They join `count` pairs of consecutive points, of which the first is a and b, each the
        MATs of its axes, and have no force at a distance of `rest` [m]. Beyond the force
        `yields` [N] the rest length follows; `breaks` [m] longer than `rest` a link breaks for
        good. Beyond `core` [m] the force falls as that of masses that attract each other; such
        links neither yield nor break. Raises EngineError.
        """
    def space_but(
        self,
        name: str,
        a: Sequence[int],
        b: Sequence[int],
        *,
        gap: float,
        count: int = 1,
        K: float = 0.0,
        Z: float = 0.0,
        exponent: float = 1.0,
        clamp: bool = False,
        cohesion: float | None = None,
        reach: float = 0.0,
    ) -> int:
        """Contacts of points nearer than `gap` [m]; ends, `count` and result as for `space_ref`.

        They push by K·p^exponent + Z·dp/dt at depth p [m]; with `clamp` this force never pulls.
        With `cohesion` [N] they also pull by that force, which falls linearly to zero until the
        ends are `reach` [m] farther apart than `gap`.
        """
    def gauge(self, name: str, a: Sequence[int], b: Sequence[int]) -> int:
        """A link between two points in space without force, to listen to its length; its index.

        Ends as for `space_ref`. Raises EngineError if they cannot be joined.
        """
    def pairwise(
        self,
        name: str,
        a: tuple[Sequence[int], int],
        b: tuple[Sequence[int], int],
        *,
        gap: float = 0.0,
        K: float = 0.0,
        Z: float = 0.0,
        exponent: float = 1.0,
        clamp: bool = False,
        inside: bool = False,
        normal: Sequence[float] | None = None,
        surface: tuple[Sequence[Sequence[float]], Sequence[Sequence[int]]] | None = None,
        friction: float = 0.0,
        core: float | None = None,
        cohesion: float | None = None,
        reach: float = 0.0,
    ) -> int:
        """Contacts between all points of two groups; the index of the first LIA, of which there is
        one for each point of `b`.

        A group is the MATs of its first point's axes, and its count; with the same group twice,
        contacts are between all its points. Group `b` must not be smaller than `a`. Contacts
        push as those of `space_but` do, at distances below `gap` [m]; with `inside`, above it;
        with `normal`, (3,) and of length 1, when `b` is less than `gap` above the plane through
        the point of `a`; with `surface`, its corners (n, 3) [m] from the point of `a` and its
        triangles (n, 3), when `b` is nearer than `gap` to a triangle. `friction` is the
        coefficient of dry friction across a contact. With `core` [m] the points attract each
        other as those of `space_ref`, and have no gap. `cohesion` and `reach` are as for
        `space_but`. Raises EngineError.
        """
    def bank(
        self,
        name: str,
        *,
        count: int,
        M: float,
        f: tuple[float, float],
        t60: tuple[float, float],
        spread: Literal["random", "even"] = "even",
        place: Literal["line", "spiral", "galaxy"] = "line",
        hole: float = 0.3,
        angles: Literal["random", "even"] = "even",
        seed: int = 0,
    ) -> int:
        """`count` CELs of total mass M [kg], with frequencies between the two `f` [Hz], spaced by
        logarithm.

        With an even `spread`, t60 [s] goes from the second value at the lowest f to the first at
        the highest; with a random one, f and t60 are drawn with `seed`. In a galaxy, `hole` is
        the radius of the highest f over that of the lowest.
        """
    def cells(
        self,
        name: str,
        *,
        cells: Sequence[tuple[float, float, float]],
        place: Literal["line", "spiral", "galaxy"] = "line",
        hole: float = 0.3,
        angles: Literal["random", "even"] = "even",
        seed: int = 0,
    ) -> int:
        """CELs side by side, each with f [Hz], t60 [s] and M [kg]; the index of the first."""
    def modal(
        self,
        name: str,
        *,
        M: float,
        modes: Sequence[tuple[float, float]],
        levels: Sequence[Sequence[float]],
    ) -> int:
        """A body of `modes`, each f [Hz] and t60 [s], with `levels` (n_modes, n_places) at places.

        M [kg] is the mass of a mode where its level is 1. Returns the index of the first place; the
        others follow. Raises EngineError.
        """
    def highest_mode(self, first: int) -> float:
        """Frequency [Hz] of the highest mode of the STRING or PLATE that begins at index `first`.

        The body is taken by itself, without losses.
        """
    def count(self, first: int) -> int:
        """Number of MATs of the module that begins at index `first`: 1, or those of a generator."""
    def centre(self, first: int) -> int:
        """Index of the middle MAT of the module that begins at `first`."""
    def start(self, index: int, X0: float, V0: float) -> None:
        """Set the initial position [m] and velocity [m/s] of one MAT."""
    def position_of(self, index: int) -> Place:
        """Place of the MAT on the bench, for pictures and `nearest`."""
    def ref(
        self, name: str, a: int, b: int, *, K: float = 0.0, Z: float = 0.0, rest: float = 0.0
    ) -> int:
        """Spring K [N/m] and damper Z [N·s/m] between MATs a and b, at `rest` [m]; the LIA's index.

        RES has Z = 0, FRO has K = 0.
        """
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
        """A one-sided contact of the striker a on b; the LIA's index.

        K [N/m^exponent] and Z [N·s/m] act once a is less than `gap` [m] away from its `side`.
        `magic` takes K and Z from `restitution` and the number of `steps` that a contact lasts.
        """
    def bristle(
        self,
        name: str,
        a: int,
        b: int,
        *,
        sigma0: float,
        Fc: float,
        sigma1: float = 0.0,
        sigma2: float = 0.0,
        Fs: float | None = None,
        vs: float = 0.001,
    ) -> int:
        """A friction with memory between MATs a and b; the LIA's index.

        Bristles of stiffness sigma0 [N/m] and damping sigma1 [N·s/m] slip at Fc [N], or at Fs
        [N] while they slide more slowly than `vs` [m/s]; sigma2 [N·s/m] is viscosity. `Fs` None:
        Fc.
        """
    def dry(
        self,
        name: str,
        a: int,
        b: int,
        *,
        F: float,
        static_level: float | None = None,
        speed: float = 0.001,
    ) -> int:
        """Dry friction between MATs a and b that holds rigidly; the LIA's index.

        While the MATs slide, it gives F [N] against the velocity. While they stick, it gives up
        to its level against the force that would set them off. The level is `static_level` [N]
        near rest (None: F), and has fallen most of the way to F at `speed` [m/s].
        """
    def space_lnl(
        self, name: str, a: Sequence[int], b: Sequence[int], law: Law, rest: float
    ) -> int:
        """A link between two points in space with a law of distance - `rest` [m]; its index."""
    def lnl(self, name: str, a: int, b: int, law: Law, *, rest: float = 0.0) -> int:
        """A link between MATs a and b with a law, at `rest` [m]; the LIA's index."""
    def following_lnl(
        self,
        name: str,
        a: int,
        b: int,
        *,
        law: str | None,
        damping: str | None,
        constants: Mapping[str, float],
        follows: Sequence[tuple[str, tuple[int, float, float, float, float]]],
        rest: float = 0.0,
    ) -> int:
        """A link with a law some of whose constants follow MATs; the LIA's index.

        Each of `follows` is the name of a constant and (index, offset [m], span [m], from, to):
        the value is `from` while the MAT `index` is at -offset or before, changes linearly to
        `to` over the next `span`, and stays there beyond. Raises EngineError.
        """
    def laws(self) -> list[LawUse]:
        """Every different law that has rows, and how many links have it."""
    def native(self, entries: Sequence[_NativeLaw]) -> None:
        """Compute laws by native code: each entry is (index in `laws`, address of the code).

        Raises IndexError.
        """
    def impose(self, index: int) -> None:
        """Impose the MAT's position (ENX): Timeline.drive says where it goes."""
    def listen(
        self,
        name: str,
        *,
        positions: Sequence[ModuleRange | tuple[int, int, float]] = ...,
        forces: Sequence[ModuleRange | tuple[int, int, float]] = ...,
        ground_forces: Sequence[ModuleRange | tuple[int, int, float]] = ...,
        lengths: Sequence[ModuleRange | tuple[int, int, float]] = ...,
        order: int = ...,
    ) -> int:
        """An output: a weighted sum over modules, differentiated `order` times by time; its index.

        The sum is of weight · position [m] of MATs, weight · force [N] of LIAs on their second
        point, weight · K·(x - rest) [N] of CELs, and weight · length [m] of LIAs in space. Order
        0 is the sum itself, 1 its speed (7.5 frames late), 2 its acceleration (8 frames late).
        """
    def name_of(self, index: int) -> str:
        """The name of a MAT as in the score, e.g. `gong.12`."""
    def elements(self, parts: Sequence[str]) -> Elements:
        """The masses and links of some parts, with the links between them and without those to
        others.

        Raises EngineError if a part does not exist.
        """
    def admittance(
        self,
        parts: Sequence[str],
        forced: Sequence[int],
        observed: Sequence[Sequence[int]],
        frequencies: Sequence[float],
    ) -> NDArray[np.complex128]:
        """Velocity of each of `observed` over a force at `forced`, (n_observed, n_frequencies)
        [(m/s)/N].

        A point is one or more masses: each gets the force, and their velocities are added up.
        The parts are taken by themselves, contacts open, laws at their slope at rest. Infinite
        at the frequency of an undamped mode. Raises EngineError if a part does not exist, or if
        a frequency [Hz] is not above 0.
        """
    def undifferentiated(self) -> Network:
        """The same network with positions in place of each SOV and SOA."""
    def certify(self, rate: float) -> Certificate:
        """The certificate that the CA scheme is stable at `rate` [Hz]. Raises UnstableError."""
    def modes(self, part: str, n_modes: int) -> list[Mode]:
        """The lowest modes of a part, whatever its damping, as `part_modes` finds them.

        A mode beyond critical damping has f 0 and the T60 of its slower pole. Raises EngineError
        if the part does not exist.
        """
    def part_modes(
        self,
        part: str,
        *,
        count: int | None = None,
        to: float | None = None,
        around: float | None = None,
    ) -> PartModes:
        """Modes of a part: the lowest `count`, all up to `to` [Hz], or `count` next to `around`
        [Hz].

        The part is taken without its links to other parts, its contacts open, its laws at their
        slope at rest. Raises EngineError if the part does not exist, or if there are too many
        modes for the memory.
        """

@final
class Certificate:
    """A stability certificate of the scheme: λmax(M⁻¹(K+2Z)) < 4, all contacts closed, laws by
    their slope at rest.
    """

    lambda_max: float
    method: Literal["gershgorin", "dense", "lanczos"]
    guarantee: Literal["proved", "guarded", "tried"]
    oversampling: int  # ceil(sqrt(λmax/4)): 1 when stable

class PathPoint(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s²] of a path at one instant."""

    x: float
    v: float
    a: float

@final
class Take:
    """A recorded movement: the natural quintic spline through samples (t [s], x [m]), both (n,).

    `trim` keeps t in [from, to] and sets `from` to zero; `smooth` is a 4th-order Butterworth
    low-pass
    [Hz], forward and backward. Raises EngineError unless t rises, all numbers are finite, and there
    are at most 20,000,000 samples.
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
        """The part between two instants [s], which begins at zero. Raises EngineError."""
    def evaluate(self, t: float) -> PathPoint:
        """The motion at t [s]."""
    def positions(self, t: _Floats) -> _Floats:
        """Positions [m] at instants t [s], both (n,); fastest where t rises."""

class RecordedAxis(NamedTuple):
    """The player and the key of an axis of a recording."""

    player: str
    key: str

class RecordedEvent(NamedTuple):
    """An event of a recording: its tick, and a line of JSON."""

    tick: int
    line: str

@final
class Recording:
    """The movement of live hands, tick by tick; sizes: n_ticks rows, n_axes axes.

    `rate` [Hz] is that of the sound and a tick has `frames` frames: row k was used from frame
    ticks[k]·frames on. `about` is JSON from the recording program. In a recording made by this
    constructor forces and flags are zero. Raises EngineError if ticks do not rise or positions
    are not (n_ticks, n_axes).
    """

    def __new__(
        cls,
        rate: float,
        frames: int,
        axes: Sequence[RecordedAxis | tuple[str, str]],
        about: str,
        ticks: NDArray[np.uint64],
        positions: _Floats,
    ) -> Self: ...
    rate: float
    frames: int
    axes: list[RecordedAxis]
    names: list[str]  # of the axes, all different
    about: str
    events: list[RecordedEvent]
    duration: float  # from the first tick to the end of the last [s]
    dropped: int  # rows and events that did not fit into the buffer while recording
    lost_bytes: int
    is_complete: bool  # nothing of the file is lost
    finished: bool  # the recorder came to its end
    damage: str | None  # a sentence on what is wrong with the file, and what is left
    def ticks(self) -> NDArray[np.uint64]:
        """The tick of each row, rising, (n_ticks,)."""
    def positions(self) -> _Floats:
        """Positions that the simulation used [m], (n_ticks, n_axes)."""
    def forces(self) -> _Floats:
        """Forces of the piece on the keys [N], (n_ticks, n_axes)."""
    def sent(self) -> NDArray[np.float32]:
        """Forces sent to the devices, after the safety stages [N], (n_ticks, n_axes)."""
    def flags(self) -> NDArray[np.uint8]:
        """Sums of 1 fresh, 2 touch, 4 force enabled, 8 stand-in, 16 tripped, (n_ticks, n_axes)."""
    def clocks(self) -> NDArray[np.uint32]:
        """The devices' own clocks [µs], as the devices send them, (n_ticks, n_axes)."""
    def held(self) -> _Floats:
        """Positions [m] at every tick, (n, n_axes); a gap holds its last value."""
    def to_bytes(self) -> bytes:
        """The bytes of a complete `.take` file. Raises EngineError."""

def read_recording(path: str | PathLike[str], span: tuple[int, int] | None = None) -> Recording:
    """Read the undamaged rows of a `.take` file; `span` (from, to) keeps these ticks, counted from
    the first row.

    Raises OSError, and EngineError if the file is not a recording or has more than 20,000,000
    rows · axes.
    """

@final
class Motion:
    """A `.motion` file, up to its last whole chunk."""

    manifest: str  # JSON
    is_whole: bool
    is_cut: bool
    duration: float
    names: list[str]
    def places(self) -> _Floats:
        """x, y, z and rest position of each point [m], (n_points, 4)."""
    def chunks(self) -> list[MotionChunk]:
        """All whole chunks."""
    def payload(self, chunk: int) -> bytes:
        """The payload of a chunk. Raises EngineError if the chunk does not exist."""
    def displacements(self, instants: Sequence[float]) -> _Floats:
        """Displacements of all points [m] at rising instants [s], (n_instants, n_points).

        NaN at instants without data. Raises EngineError if the file is damaged.
        """

def motion_bound() -> dict[str, float]:
    """How far displacements in a motion file may be off, as in its manifest (docs/motion.md)."""

def read_motion(path: str | PathLike[str]) -> Motion:
    """Read a `.motion` file up to its last whole chunk.

    Raises OSError, and EngineError if the manifest or a table is not whole.
    """

# --- what will happen ---------------------------------------------------------------------------

@final
class Timeline:
    """All events of a piece, by sample index.

    It keeps a copy of the network, which must be complete. Methods raise EngineError for
    arguments that are impossible or that do not exist; gesture, take and strike also raise
    StoppedError.
    """

    def __new__(cls, network: Network, rate: float) -> Self: ...
    def leave_unguarded(self) -> None:
        """Step every frame of CA once, also where links have stiffened beyond stability."""
    def open(self) -> None:
        """Mark the timeline as incomplete (a session): no plan may rely on what is absent."""
    def key(self, name: str, struck: int) -> int:
        """Declare the part `name` as a key, moved at the MAT `struck`; returns its index."""
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
        """A written gesture, which passes x[i] [m] at t[i] [s] of the piece; its index.

        curve[i] leads to point i (curve[0] is ignored); `sources[i]` is any number, which
        Simulation.ergons returns. `grain` and `join` are in [s], `force_limit` in [N].
        """
    def ranges(self) -> list[Range]:
        """Lowest and highest position [m] of each gesture's written points and paths, by index."""
    def strikes_on(self, mat: int) -> list[Impulse]:
        """The strikes on a MAT in order of their instants; an ergon brings mass times speed."""
    def impulses_on(self, mat: int) -> list[Impulse]:
        """The impulses, each at one instant, of which the strikes on a MAT consist; an ergon brings
        mass times speed.
        """
    def take(
        self,
        key: int,
        take: Take,
        start: float,
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
        """A gesture that plays a take from `start` to `until` [s]: x·scale at t·stretch; its
        index.
        """
    def strike(
        self,
        mat: int,
        start: float,
        *,
        impulse: float | None = None,
        mass: float | None = None,
        speed: float | None = None,
        lasts: float | None = ...,
        source: int = 0,
    ) -> None:
        """A strike on a MAT at `start` [s]: an impulse [N·s], or a mass [kg] and speed [m/s].

        The force of an impulse is Blackman's window over `lasts` [s], 0 to 0.05. None is 0.19 ms;
        under `ca` one step. Raises EngineError if the MAT is fixed or it lasts longer.
        """
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
        lasts: float | None = ...,
        source: int = 0,
        within: tuple[float, float] = ...,
    ) -> int:
        """Strikes on each MAT by a Poisson process from `start` to `stop` [s]; their number.

        `rate` [Hz] is per MAT; impulses [N·s] are uniform. Member i draws from Chance(seed,
        "strikes", name, i, 0). Strikes outside `within` [s] are drawn and left out.
        """
    def couple(
        self, link: int, start: float, stop: float | None = None, fade: float = 0.02
    ) -> None:
        """Let the LIA act only from `start` to `stop` [s], with fades of `fade` [s]."""
    def fade(
        self, link: int, before: float, after: float, start: float, stop: float, *, n: int = 1
    ) -> None:
        """Scale the force of `n` LIAs from `link` on: by `before` until `start` [s], by `after`
        from `stop` [s] on, linearly between, on multiples of GRID frames.

        The LIAs must be whole runs. A spring whose K and Z change in one ratio fades as
        fade(link, K_old / K, 1, ...). Gestures are computed for their key without the LIAs whose
        `after` is 0.
        """
    def glide(self, mat: int, k: float, z: float, m: float, start: float, stop: float) -> None:
        """Give a MAT K [N/m], Z [N·s/m] and M [kg] until `start` [s], and the network's own from
        `stop` [s] on, linearly between, on multiples of GRID frames.

        The MAT is stepped.
        """
    def retune(self, mat: int, points: Sequence[tuple[float, float, float]], *, n: int = 1) -> None:
        """Let `n` CELs from `mat` on go through points (t [s], square of the factor of their
        frequencies, factor of their decay rates), which rise.

        Values change linearly between points, on multiples of GRID frames, and stay before the
        first and after the last. Raises EngineError if a MAT is not an oscillating CEL.
        """
    def lead(self, link: int, points: Sequence[tuple[float, float, float]], *, n: int = 1) -> None:
        """Let K and Z of `n` LIAs from `link` on, whole runs, go through points (t [s], factor of
        K, factor of Z), which rise.

        Values change linearly between points, on multiples of GRID frames, and stay before the
        first and after the last. The q of a hardening spring does not change. A body whose links
        are led is stepped. Raises EngineError if a link has no K that can change.
        """
    def path(self, mat: int, points: Sequence[tuple[float, float, float, float]]) -> None:
        """Let K [N/m], Z [N·s/m] and M [kg] of a MAT go through points (t [s], K, Z, M), which
        rise.

        Values change linearly between points, on multiples of GRID frames, and stay before the
        first and after the last. The MAT is stepped.
        """
    def cut(self, frame: int, gestures: Sequence[int], *, stops: bool) -> Timeline:
        """The timeline without what begins at `frame` or later; it keeps the `gestures` of these
        indices, which rise.

        If it `stops`, couplings stay as they are at the frame. Strikes and glides that are over
        by then are left out; keys, drives, inputs, and what moves parameters stay.
        """
    def release(self, mats: Sequence[tuple[int, int]], links: Sequence[tuple[int, int]]) -> None:
        """Let nothing move the parameters of MATs and LIAs any more; rows of (first, number)."""
    def delay_forces(self, port: int, key: int, delay: float) -> None:
        """Let the fixed point `port` go where the MAT `key` goes, and pass the sum of the forces on
        it to the key `delay` [s] later, at least a step.

        Raises EngineError if the delay is not from 0 to 1 s.
        """
    def strike_point(self, mat: int, point: int, *, lasts: float | None = ...) -> None:
        """Let Simulation.strike strike a MAT, which it calls by the number `point`; each strike
        lasts as in `strike`.

        Raises EngineError if the MAT is fixed.
        """
    def trial_strike(self, mat: int, impulse: float, *, lasts: float | None = ...) -> None:
        """Declare the hardest strike [N·s] that a MAT may get while the timeline is open.

        It `lasts` as in `strike`.

        Only trials of plans play it, to choose how finely contacts are computed. Raises EngineError
        if the MAT is fixed.
        """
    def sound_in(
        self,
        channel: int,
        samples: _Floats,
        *,
        gain: float,
        clamp: float,
        highpass: float | None = None,
    ) -> int:
        """Declare an input of a sound card; returns its index.

        `channel` counts from 0. Full scale is `gain` [m or N], after a Butterworth high-pass of
        order 2 [Hz]; values are clipped to `clamp` [m or N]. `samples` (n_frames,), full scale
        1, at the rate of the timeline, are heard from frame 0 on if no live sound is given.
        Raises EngineError.
        """
    def controlled_input(
        self, number: int, samples: _Floats, *, gain: float, clamp: float, glide: float
    ) -> int:
        """Declare an input that Simulation.tell tells values by its `number`; returns its index.

        Each value is reached linearly within `glide` [s], at most 60, and held until the next.
        `samples` are heard until the first value; the other arguments are as for `sound_in`.
        Raises EngineError.
        """
    def drive(
        self,
        mat: int,
        kind: Literal["position", "force"],
        *,
        constant: float | None = None,
        take: Take | None = None,
        sound: int | None = None,
        start: float = 0.0,
        scale: float = 1.0,
        acts_on_free_key: bool = True,
    ) -> None:
        """Impose a MAT's position [m] (ENX) or a force on it [N] (ENF): a constant, a take, or an
        input.

        `sound` is an index that `sound_in` or `controlled_input` returned: frame n is computed
        with value n times `scale`. The take begins at `start` [s]; before that its first value
        holds, after its end its last. If it `acts_on_free_key`, the free copy of a key feels it
        too, as it should what belongs to the MAT's part.
        """
    def hand(
        self,
        mat: int,
        tick_frames: int,
        *,
        interpolation: Literal["hold", "line"] = "line",
        positions: _Floats | None = None,
    ) -> int:
        """A real hand that moves a MAT, in ticks of `tick_frames` frames; its index.

        `positions` (n_ticks,) [m]: a stand-in or a recording of the hand. `interpolation`: between
        two ticks the position is held, or goes along a line.
        """

# --- what is computed ---------------------------------------------------------------------------

class TrialRecord(NamedTuple):
    """Results and cost of the trials of an island."""

    numbers: list[float | None]  # finite
    counts: list[list[int]]
    reason: str | None

@type_check_only
class TrialStore(Protocol):
    """A store of trial records, by keys of 64 hex digits."""

    def get(self, key: str, /) -> TrialRecord | None:
        """The record under a key, or None."""
    def put(self, key: str, record: TrialRecord, /) -> None:
        """Keep a record, if possible."""

class ModeCount(NamedTuple):
    """How many modes of a body are computed, and how many it has."""

    computed: int
    total: int

class IslandChoice(NamedTuple):
    """The decisions of a plan on one island.

    `bodies`: for each body numbers, of which the first says what the others are: 0, modes; 1, the
    method of a mesh, its steps and whether it replaces modes; 2, steps of the island to one of a
    slow body; 3, all modes of an island that is a bank.
    """

    modules: int
    oversampling: int  # steps a frame
    contact_substeps: int  # computations of contacts a step
    bodies: list[list[int]]
    counted_cost: int | None  # work that depends on the motion [ns a frame], if trials counted it
    contact_order: int  # order of contacts between frames in the fewest computations, 2 or 4

class FullRatePart(NamedTuple):
    """A part with its own rate that is computed at every frame, and why."""

    name: str
    why: str

class AudibleError(NamedTuple):
    """The audible error, at its worst: of the strongest partials, of third octaves, of strokes.

    `t60` is relative to the T60; `third_octave_db` counts only third octaves that the others do
    not mask. How early or late the first stroke begins, and a later one [s]; where strokes follow
    each other within 50 ms, `stroke_db` is the mean difference of the level over 50 ms.
    """

    cents: float
    t60: float
    third_octave_db: float
    first_stroke_s: float
    later_stroke_s: float
    stroke_db: float

class TrialWork(NamedTuple):
    """Work of a plan's trials, and the most allowed, by the table of costs [s]."""

    done: float
    allowed: float

@final
class PlanRow:
    """A part of a plan: what is computed together, and how; or what is not computed, and why."""

    parts: list[str]
    n_mat: int  # MATs that move
    n_lia: int
    what: Literal[
        "stepped",
        "oscillators",
        "modes",
        "complex modes",
        "ca2p",
        "bm4",
        "ieq",
        "e4",
        "unheard",
        "still",
    ]
    modes: ModeCount | None
    left_out_db: float | None  # level of the modes that are not computed, relative to all
    oversampling: int  # steps in `every` frames
    every: int  # 1, except for parts that are only seen
    contact_substeps: int  # computations of contacts a step, while they may be closed
    contact_order: int  # their order, 2 or 4
    error_db: float | None  # error of the waveform that a pilot measured
    error_s: float | None  # time from the start over which it was measured [s]
    spectral_db: float | None  # if chaotic later on: mean difference of third octaves
    audible: AudibleError | None  # the audible error, if it was judged by pitch
    cost: float  # seconds of work for a second of sound, by the table of costs
    guarantee: Literal["proved", "guarded", "tried"] | None
    because: str | None  # why it is not computed by a better method
    macrostep: int | None  # frames between two pulls of its own springs
    radius: float | None  # largest |eigenvalue| of the map between two pulls, with all it touches
    preserved: bool  # slow, error at most -75 dB up to 10 frames, -70 dB up to 20
    offered: bool  # slow by the plan's choice, not by a rate of its own: it costs less
    stays: str | None  # parts with their own rate that are computed at every frame, and why
    reference: bool  # its discrete network is the truth: nothing but what is left out is an error
    drafted: bool  # planned for a low cost, since no earlier plan has run its trials
    cut_short: bool  # the allowance of work for trials was spent before all were played
    diverges: bool  # its motion diverged in its trial
    harder_at: float | None  # from here on it is played harder than in the pilot [s]
    unchecked_from: float | None  # from here on its error may grow, and was not checked [s]

@final
class Plan:
    """How network and timeline are computed: the cheapest method for each island that is heard.

    At most one of `method`, `error_db` (error of the waveform) and `cents` (error of pitch up to
    `upto` [Hz]) may be given; without any the error stays inaudible. Raises EngineError,
    UnstableError and StoppedError.
    """

    def __new__(
        cls,
        network: Network,
        timeline: Timeline,
        *,
        method: Literal["ca", "modal", "ca2p", "bm4", "ieq"] | None = None,
        error_db: float | None = None,
        cents: float | None = None,
        upto: float | None = None,
        pins: Sequence[IslandChoice] | None = None,
        store: TrialStore | None = None,
        like: Plan | None = None,
        share: float = 1.0,
        draft: tuple[float, float] | None = None,
        seen: Sequence[str] = ...,
        seen_every: int = 1,
    ) -> Self:
        """Make a plan.

        `pins`: the `choices` of an earlier plan of the same score, which are used again.
        `store`: results of trials of earlier plans, where new results are kept too. An island
        whose beginning has not changed is not tried again; the plan is the same as without a
        store. Exceptions of `store` are raised.
        `like`: a plan of another version, whose modes of unchanged bodies are used again.
        `share` (0 to 1): the part of the allowance of work that the trials may take.
        `draft` (error [dB], share): islands are planned as an earlier plan within the accuracy, as
        `store` says; those that it does not know, for that error, by that share of work.
        `seen`: parts that somebody looks at. They are computed even if nobody hears them; the
        samples that are heard do not change.
        `seen_every`: parts that nobody hears may be computed once in this many frames.
        """

    @staticmethod
    def with_fine_contacts(network: Network, timeline: Timeline) -> Plan:
        """Every module stepped as written, with contacts computed several times a frame.

        A simulation of this plan records its ergons. Raises EngineError."""
    def rows(self) -> list[PlanRow]:
        """The parts of the plan."""
    def seen(self) -> list[PlanRow]:
        """The parts that are computed although nobody hears them, because somebody looks at them;
        `hash` does not include them.
        """
    def choices(self) -> list[IslandChoice]:
        """The decisions, island by island."""
    def stay(self) -> list[FullRatePart]:
        """The parts with their own rate that are nevertheless computed at every frame."""
    trials: TrialWork
    hash: str  # of the decisions: 64 hex digits

# --- what moves ---------------------------------------------------------------------------------

@final
class Report:
    """How one gesture went, over the frames that it ran."""

    gesture: int
    n_ergons: int
    start: float  # first and last instant at which it ran [s]
    stop: float
    worst: float  # largest |done - asked| on the loaded key [m], and when [s]
    worst_at: float
    pushed_by: str | None  # the MAT of another part that pushed most at `worst_at`
    compared: int  # frames compared
    rms: float  # [m]
    low: float  # excursion of the free key from the gesture's start to the next one's [m]
    high: float
    strongest: float  # largest velocity step of one ergon [m/s]
    force_max: float  # largest |force| of one ergon [N]
    missed: int  # steps that needed more than force_limit
    first_point_missed: bool  # it interrupted an earlier gesture and joined after its first point

@final
class Energy:
    """The energies of a simulation [J]: start + injected = stored + lost - produced + residual."""

    start: float
    stored: float
    injected: float
    lost: float
    produced: float
    residual: float
    flow: float  # start + Σ|injected| + Σ|lost| + Σ|produced|: the scale of the residual

@final
class MotionLook:
    """What can be seen of a simulation: every mass, whatever computes it."""

    def __new__(cls, simulation: Simulation) -> Self: ...
    n_modes: int
    def mats(self) -> list[int]:
        """The MAT of each point, (n_points,)."""
    def runs(self) -> list[LookRun]:
        """The points in runs of one kind."""
    def contacts(self) -> list[LookContact]:
        """Links that open and close."""

@final
class MotionRecorder:
    """Writes the motion of a simulation into the chunks of a motion file. Changes no sample."""

    def __new__(
        cls,
        simulation: Simulation,
        look: MotionLook,
        timeline: Timeline,
        *,
        manifest: str,
        places: _Floats,
        keys: Sequence[int],
        n_speakers: int,
        fps: float,
    ) -> Self:
        """`manifest`: JSON; `places`: places of the points [m], (n_points, 3); `keys`: the MAT of
        each key.

        Raises EngineError if a table would be too long.
        """
    next: int
    def look(self, simulation: Simulation) -> None:
        """Record the state of the simulation, which is at frame `next`."""
    def hear(self, mixed: _Floats) -> None:
        """Measure the sound of the loudspeakers since the last look, (n_frames, n_speakers)."""
    def take(self) -> bytes:
        """The bytes that were completed since the last call."""
    def finish(self) -> bytes:
        """The last bytes of the file."""

@final
class Window:
    """The view of a simulation that pages get while it is played. Changes no sample."""

    def __new__(
        cls,
        simulation: Simulation,
        look: MotionLook,
        timeline: Timeline,
        *,
        manifest: str,
        places: _Floats,
        keys: Sequence[int],
        n_speakers: int,
        fps: float,
    ) -> Self:
        """Arguments as for MotionRecorder. A window can be shown once. Raises EngineError if a
        table would be too long.
        """

@final
class Snapshot:
    """The state of a simulation at one frame."""

class MutedPart(NamedTuple):
    """A part that became non-finite at a frame and was muted."""

    name: str
    frame: int

class EnergyGain(NamedTuple):
    """A module whose steps made more energy than a hundredth of what was there."""

    name: str
    frame: int  # frame by which it was worst
    sentence: str

class FinerPart(NamedTuple):
    """A part some of whose frames needed more than one step, because its links had stiffened."""

    name: str
    frames: int  # how many frames
    steps: int  # most steps of one frame

@final
class StorableIsland:
    """An island of a simulation whose stretches can be stored; made by Simulation.storable.

    `n_out` outputs hear it. `cost` is its work by the table of costs [ns a frame].
    """

    n_out: int
    cost: float

@final
class IslandStretch:
    """A stretch of an island: its sound (n_frames · n_out,) [m or N], and its state at the end."""

    @property
    def sound(self) -> _Floats: ...
    @property
    def state(self) -> bytes: ...

@final
class Simulation:
    """Computes a network and its timeline by a plan; without a plan, every module as written.

    `ledger` is only possible without a plan, `record` only if no ergon strikes inside a body of
    the plan. Raises EngineError, UnstableError and StoppedError.
    """

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
        """`start`: the first frame; earlier events are left out, and everything begins at X0 unless
        `take_over` follows. `unchecked`: run a network that the certificate refuses.
        """
    rate: float
    frame: int
    n_out: int
    def process(self, out: _Floats) -> None:
        """Fill out (n_frames, n_out), C-contiguous, with the next frames.

        Raises DivergedError, StoppedError, and EngineError after a StoppedError.
        """
    def positions(self) -> _Floats:
        """Positions now [m], (n_mat,); NaN for MATs that the plan does not compute."""
    def velocities(self) -> _Floats:
        """Velocities now [m/s], (n_mat,): backward differences."""
    def asked(self) -> _Floats:
        """The position that each key's gesture asks for now [m], (n_keys,); NaN for a key without a
        running gesture.
        """
    def hold(self, hand: int, x: float, step: float | None = None) -> None:
        """Set the position x [m] of a real hand from the next tick on, and its movement in the last
        frame of the tick, `step` [m].
        """
    def strike(self, point: int, impulse: float) -> bool:
        """Strike a point of Timeline.strike_point by an impulse [N·s] at the next frame.

        Impulses of one frame add up. False if the simulation has no such point. Raises
        EngineError if the impulse is not finite.
        """
    def tell(self, number: int, value: float) -> bool:
        """Let an input of Timeline.controlled_input go to a value, a part of full scale, from the
        next frame on.

        False if the simulation has no such input. Raises EngineError if the value is not finite.
        """
    def sound_in(self, frames: NDArray[np.float32]) -> None:
        """Give what a sound card hears in the next frames, full scale 1, (n_frames, n_channels).

        At most 4096 frames. From the first call on, frames for which nothing is given are silent.
        """
    @property
    def n_channels_in(self) -> int:
        """Channels of a sound card that the inputs of the timeline need."""
    def hand_force(self, hand: int) -> float:
        """Mean force of the piece on a real hand [N] over the last whole tick."""
    def fork(self) -> Simulation:
        """An independent copy in the same state."""
    def damp(self, t60: float | None) -> None:
        """Add a damping with decay t60 [s] to everything from this frame on; None: remove it.

        Free copies of keys are not damped. Raises EngineError unless t60 is above zero.
        """
    def take_over(self, old: Simulation) -> list[int | None]:
        """Take the state of `old` over, by names; `old` must not be used afterwards.

        An island of the same network continues bit for bit. Returns, for each output of `old`,
        the index of the output here. Raises EngineError unless both are at the same frame.
        """
    def snapshot(self) -> Snapshot:
        """The state now."""
    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a state of this simulation."""
    def energy(self) -> Energy:
        """The ledger. Raises EngineError unless made with ledger=True."""
    def reports(self) -> list[Report]:
        """A report of each gesture, by its index."""
    def ergons(self) -> dict[str, NDArray[np.float64]]:
        """Ergons since the last call, with record=True: columns `time` [s], `mat`, `mass` [kg],
        `speed` [m/s], `impulse` [N·s] and `source`, each (n_ergons,).
        """
    def steps_at_rest(self) -> int:
        """Steps of islands so far that were skipped because nothing moved."""
    def counted_work(self) -> float:
        """Work so far whose amount depends on the motion, by the table of costs [s]: that of
        contacts and laws between frames, and that of exact contacts beyond one solution a step.
        """
    def muted(self) -> list[MutedPart]:
        """The parts that were muted, with on_fault="mute"."""
    def gains(self) -> list[EnergyGain]:
        """Links and meshes that made energy; a single one of many is reported by its own name."""
    def created_share(self) -> float:
        """The most energy that one link or mesh has made, as a share of the energy that was there;
        0 if nothing made any.
        """
    def finer(self) -> list[FinerPart]:
        """The parts with frames of more than one step."""
    def storable(self) -> list[StorableIsland]:
        """The islands whose stretches can be stored; none with `ledger` or `record`."""
    def island_key(self, island: StorableIsland, start: int, stop: int, before: str) -> str:
        """A hash of everything that determines an island from frame 0 to `stop` (64 hex digits).

        `before` is the hash up to frame `start`, empty at 0. The hash is equal in another
        version of a score whose events differ only later.
        """
    def output_keys(self, stops: list[int]) -> list[list[str]]:
        """Hashes of everything that determines each output up to each of the rising frames `stops`
        (n_stops; n_out).

        Outputs of two simulations with the same hash have the same samples up to there. The hash
        is empty where an output is silent up to there.
        """

    def recall(self, island: StorableIsland, sound: _Floats) -> None:
        """Use `sound` (n_frames · its n_out,) [m or N] for an island from here on instead of
        computing it.

        The state of the island stands still. Raises EngineError if `sound` is not contiguous.
        """
    def silence(self, island: StorableIsland) -> None:
        """Leave an island silent, and do not compute it, until its state is set."""
    def record(self, island: StorableIsland) -> None:
        """Compute an island from here on, and record its sound."""
    def recorded(self, island: StorableIsland) -> IslandStretch:
        """The sound of an island since `record`, and its state now; the recording ends."""
    def advance(self, island: StorableIsland, n_frames: int) -> _Floats:
        """The next frames of one island (n_frames · its n_out,) [m or N]; everything else stands
        still.

        `set_state` sets the state before them, `recorded` returns the state after them. For a
        machine that computes some islands of another machine's simulation. Raises DivergedError
        and StoppedError.
        """
    def set_state(self, island: StorableIsland, state: bytes) -> None:
        """Put an island into the state that an equal island had at this frame, and compute it from
        here on.

        Raises EngineError if the bytes are not such a state; the simulation must not be used
        afterwards.
        """

# --- from outputs to loudspeakers ---------------------------------------------------------------

@final
class FrozenOutputs:
    """Samples of outputs that were computed before; mixers share them."""

    def __new__(cls, samples: _Floats) -> Self:
        """Copy samples (n_frames, n_out). Raises EngineError."""

@final
class Mixer:
    """Routes of outputs to channels, with gains and high-passes. Raises EngineError."""

    def __new__(cls, rate: float, n_out: int, n_channels: int) -> Self: ...
    def route(
        self,
        out: int,
        channel: int,
        gain: float = 1.0,
        highpass: float | None = None,
        group: int = 0,
        *,
        tones: Sequence[tuple[str, float, float]] = ...,
        delay: int = 0,
        echo: tuple[int, float] | None = None,
        curve: Sequence[tuple[int, float, bool]] | None = None,
        pan: tuple[Sequence[tuple[int, float, bool]], bool] | None = None,
        to_room: bool = False,
        squared: bool = False,
    ) -> None:
        """Add gain · output to a channel or a room (from 0).

        `highpass` [Hz] is a Butterworth of order 2. `tones` are filters after it: highpass,
        lowpass, lowshelf or highshelf, a frequency [Hz] and the level of a shelf [dB]
        (Bristow-Johnson, Audio EQ Cookbook, with Q = 1/√2 or slope 1). `delay` is in frames;
        `echo` is after how many frames what is in the delay goes into it again, by which ratio.
        `curve` is a gain over the frames of the piece: (frame, ratio, whether it is reached
        smoothly or linearly), between two points by its level in dB. `pan` are places from -1 to
        1 between two channels in the same way, between two points by the angle whose cosine and
        sine are the gains, and whether this is the second channel. `set_gain` changes the gain of
        a `group` of routes. With `squared` the square of the output is heard. Raises
        EngineError.
        """
    def room(
        self,
        name: str,
        channels: Sequence[int],
        *,
        size: float,
        t60: Sequence[tuple[float, float]],
        gain: float = 1.0,
    ) -> int:
        """Add a room that some channels (from 0) hear; its index.

        `size` [m] is the mean path of sound from wall to wall, `t60` are two pairs of frequency
        [Hz] and decay time [s], the lower frequency first. At gain 1 the response to a click has
        the energy of the click in each channel. Raises EngineError.
        """
    def freeze(self, frozen: FrozenOutputs, outputs: Sequence[int], begins: int) -> None:
        """Add frozen outputs to `outputs` (from 0), one each, from frame `begins` on.

        Raises EngineError.
        """
    def fade(self, curve: Sequence[tuple[int, float, bool]]) -> None:
        """Set a gain of all channels over the frames of the piece, as the `curve` of a route."""
    def set_gain(self, group: int, gain: float) -> None:
        """Glide the gain of a group to `gain` in 20 ms, from the next multiple of GRID on."""
    def take_over(self, old: Mixer, outputs: Sequence[int | None] | None = None) -> None:
        """Take the gains and filters of `old` over; `outputs`: for each output of `old` the output
        here, as Simulation.take_over returns them, if they differ.
        """
    def state(self) -> bytes | None:
        """The state of routes and rooms; None while a gain glides, or with frozen outputs."""
    def set_state(self, state: bytes) -> None:
        """Go on after the frames that an equal mixer has mixed. Raises EngineError."""
    def process(self, frames: _Floats, mixed: _Floats) -> None:
        """Mix frames (n_frames, n_out) into mixed (n_frames, n_channels). Raises EngineError."""

def waveform_errors(sound: _Floats, reference: _Floats, ends: Sequence[int]) -> list[float]:
    """‖sound - reference‖/‖reference - mean‖ [dB] of the worst output, from the first frame to each
    of `ends` [frames], which do not fall.

    Both are (n_frames, n_out). -inf where they are equal within rounding, inf where only the
    reference is silent. Raises EngineError for another shape.
    """

@final
class Derivatives:
    """SOV and SOA of a network, from positions at `rate` [Hz]; before the first position everything
    is at rest.

    Raises EngineError for an impossible rate.
    """

    def __new__(cls, network: Network, rate: float) -> Self: ...
    def process(self, frames: _Floats) -> None:
        """Replace in frames (n_frames, n_out) the positions of each SOV and SOA by their
        derivatives, in place.

        A SOV comes 7.5 frames late, a SOA 8. Raises EngineError for another shape.
        """

@final
class Limiter:
    """Look-ahead limiter of sample peaks: 5 ms ahead, 50 ms release, one gain for all channels.

    Raises EngineError for an impossible rate, ceiling or number of channels.
    """

    def __new__(cls, rate: float, n_channels: int, ceiling: float) -> Self: ...
    latency: int  # frames
    def process(self, frames: _Floats) -> None:
        """Limit frames (n_frames, n_channels) in place; the output is `latency` frames late."""

@final
class Fold:
    """Filters (n_in, n_out, n_taps) from each input channel to each output channel.

    The bits of a sample do not depend on the size of blocks. Raises EngineError for an
    impossible shape, or numbers that are not finite.
    """

    def __new__(cls, filters: _Floats) -> Self: ...
    tail: int  # frames that sound on after the last input frame
    def process(self, frames: _Floats, output: _Floats) -> None:
        """Filter frames (n_frames, n_in) into `output` (n_frames, n_out), which is overwritten."""

@final
class Meter:
    """Peak and integrated loudness (ITU-R BS.1770) of all frames so far. Raises EngineError."""

    def __new__(cls, rate: float, n_channels: int) -> Self: ...
    def process(self, frames: _Floats) -> None:
        """Measure frames (n_frames, n_channels)."""
    peak: float
    loudness: float  # LUFS; -inf for silence
    momentary: float  # of the last four complete tenths of a second, without gating; LUFS

@final
class LevelSteps:
    """Loudness and peaks of a sound, every tenth of a second. Raises EngineError."""

    def __new__(cls, rate: float, n_channels: int) -> Self: ...
    def process(self, frames: _Floats) -> None:
        """Measure frames (n_frames, n_channels)."""
    measured: _Floats  # (n_steps · 11,): level of the last 400 ms [LUFS], and ten peaks
    def state(self) -> bytes:
        """What the levels of later frames depend on, besides the sound."""
    def set_state(self, state: bytes, measured: _Floats) -> None:
        """Go on after frames whose levels are `measured`. Raises EngineError."""

@final
class TruePeak:
    """The largest absolute value of a sound between its samples (ITU-R BS.1770-4, Annex 2)."""

    def __new__(cls, n_channels: int) -> Self: ...
    def process(self, frames: _Floats) -> None:
        """Measure frames (n_frames, n_channels)."""
    peak: float  # at four times the rate

@final
class Lead:
    """A stream of positions that leads a virtual finger, which holds the key of the device `name`.

    The path is read with a fixed delay, by linear interpolation between time stamps.
    """

    def __new__(
        cls,
        name: str,
        *,
        finger: tuple[float, float, float],
        delay: float,
        range: tuple[float, float],
        spring: tuple[float, float] = ...,
        lockstep: bool = False,
        present: bool = True,
        traced_ticks: int = 0,
    ) -> Self:
        """`finger` is its spring [N/m] and damper [N·s/m] to the pointer, and its mass [kg].

        `delay` [s] is that of the path, `range` [m] the key's two ends, `spring` its stiffness
        [N/m] about a rest [m]. In lockstep time is that of the ticks. A key whose player is not
        `present` is played by its stand-in. The first `traced_ticks` ticks are kept. Raises
        EngineError for impossible numbers, or a name that is in use.
        """
    @property
    def name(self) -> str:
        """The URL of the device."""
    @property
    def range(self) -> tuple[float, float]:
        """The two ends of the key's travel [m]."""
    @property
    def force(self) -> float:
        """The force of the pointer on the finger at the end of the last tick [N]."""
    def now(self) -> float:
        """Time of the stream's clock [s]; not for lockstep."""
    def place(self, time: float, x: float, firmness: float = 1.0) -> bool:
        """The pointer was at `x` [m] at `time` [s]; False if that is refused, and counted.

        The stiffness of the finger is multiplied by `firmness`. A time that is over 0.5 s old or
        5 ms ahead is replaced by that of the arrival.
        """
    def lift(self, time: float) -> bool:
        """The pointer was lifted at `time` [s]; False as for `place`."""
    @property
    def present(self) -> bool:
        """Whether a player is there."""
    def set_present(self, present: bool) -> None:
        """The player has come or gone; without one the stand-in plays."""
    def close(self) -> None:
        """Give the name back: another stream may have it."""
    def trace(self) -> _Floats:
        """What happened in each tick that is kept, (n_ticks, 6).

        Columns: the pointer at its beginning and its end [m] and the factor of the finger's
        stiffness, NaN without a finger; the force on the key [N]; finger and key at its end [m].
        """
    def discard(self) -> None:
        """Discard the positions that wait, where no performance reads them."""
    def arrival_times(self, part: float) -> tuple[float, float, float]:
        """The quantile `part` of the gaps between positions while the pointer moves, of the times
        from stamp to arrival, and of the delays that the path would need [s].

        Each is rounded up to 0.25 ms; 0 where nothing came.
        """
    @property
    def tally(self) -> dict[str, float]:
        """Numbers of positions `taken`, `refused`, `misdated` and `late`; the mean `gap` between
        them while the pointer moves, and its standard `deviation` [s].
        """

def even_path(
    stamps: _Floats, arrivals: _Floats, positions: _Floats, times: _Floats, delay: float
) -> tuple[_Floats, int]:
    """The even path [m] that a finger follows at rising `times` [s], and how many positions came
    too late for it.

    The pointer was at `positions` [m] at the instants `stamps` [s], which became known at
    `arrivals` [s], in this order. At each time the path is read where it was `delay` [s] earlier;
    NaN before its first position.
    """

@final
class ViewServer:
    """Serves the page, with a `.motion` file or what is played, to browsers until it is closed, by
    HTTP and WebSocket on one port.
    """

    def __new__(
        cls,
        path: Path | str | None = None,
        *,
        sound: Path | str | None = None,
        address: str = "127.0.0.1:0",
        key: str,
        leads: Sequence[Lead] = ...,
    ) -> Self:
        """Listen at HOST:PORT; port 0 is any free one. The `key`, 32 hexadecimal digits, is part of
        every address: other users of this machine can reach the port too.

        `sound` is a WAV file of one or two channels, which pages that ask for it play with the
        picture. Pages may play the keys of `leads`. Raises EngineError if the address does not
        belong to this machine.
        """
    @property
    def url(self) -> str:
        """The address to open in a browser on this machine."""
    @property
    def tally(self) -> dict[str, int]:
        """Counts: requests `served` and `refused`, pages `dropped`, present `viewers`, and pictures
        of performances that were `skipped`.
        """
    def show(self, window: Window, performance: Performance) -> None:
        """Show a performance through `window`, as soon as the simulation plays for which the window
        was made (the performance's own or one of a change).

        Raises EngineError if the server or the performance is closed, or if the window was shown
        already.
        """
    def close(self) -> None:
        """Close the server and the connections of all pages."""

@final
class SilenceDetector:
    """Looks for the first tenth of a second, after frame `start`, that begins a quiet second.

    Quiet is 80 dB below the highest peak before. The place does not depend on the size of blocks.
    """

    def __new__(cls, rate: float, n_channels: int, start: int) -> Self:
        """Detect in frames at `rate` [Hz]; `start` counts from 0."""
    def take(self, frames: _Floats) -> int | None:
        """Take (n_frames, n_channels); the frame at which the sound has faded, once that is
        known.
        """

def pcm(frames: _Floats, gain: float, bits: Literal[16, 24]) -> NDArray[np.int32]:
    """frames · gain as integers in the top bits of an int32, rounded half to even, clipped.

    Raises EngineError for other bits.
    """

def crc32(bytes: NDArray[np.uint8], start: int = 0) -> int:
    """The CRC-32 (as of zlib) of bytes that come after those of which it is `start`."""

def packed(codes: NDArray[np.int32], width: int) -> bytes:
    """The top `width` bytes (1 to 4) of codes in C order, the lowest of each first.

    Raises EngineError for other widths.
    """

def single(frames: _Floats, gain: float) -> NDArray[np.float32]:
    """frames · gain in single precision, of the same shape."""

# --- sound cards ----------------------------------------------------------------------------------

@final
class AudioOut:
    """A sound output: `auto`, `jack[:PORTS]`, `pulse[:SINK]`, `file:PATH`, `null`, `null:fast`."""

    def __new__(cls, spec: str, rate: int, n_channels: int, capacity: int = 4096) -> Self:
        """Open the output, with a ring of `capacity` frames. Raises EngineError if it cannot be
        opened.
        """
    room: int  # free frames of the ring
    def set_prefill(self, n_frames: int) -> None:
        """Begin, and begin again after an underrun, once the ring holds `n_frames`."""
    def push(self, frames: NDArray[np.float32]) -> int:
        """Write frames (n_frames, n_channels) without waiting; returns how many were taken."""
    def play(self, frames: NDArray[np.float32]) -> None:
        """Write all frames (n_frames, n_channels), waiting for room."""
    def finish(self, limit: float) -> bool:
        """Mark the end and wait until all frames were heard; False if `limit` [s] passes first."""
    def close(self) -> None:
        """Close the output; a file gets its final name. Raises EngineError if the file cannot be
        written.
        """
    def panic(self) -> None:
        """Silence within 5 ms, until `release`."""
    def release(self) -> None:
        """Sound again, faded in."""
    info: AudioInfo
    events: list[AudioEvent]  # all so far
    alive: bool  # a card or server takes frames
    freewheeling: bool  # a JACK server that runs as fast as it can
    underruns: int
    missing: int  # frames of silence that underruns put in
    played: int  # frames of the score that went to the card
    discarded: int  # frames that a panic threw away
    xruns: int  # late cycles that the server, the card or the silent clock reported

@final
class AudioInfo:
    """Where the frames of an output go."""

    backend: str
    device: str
    rate: int  # of the card or file [Hz]
    block: int  # [frames]
    latency: float  # [s]
    sentence: str  # all of the above in words

@final
class AudioEvent:
    """An event of an output, e.g. an underrun or a server that died."""

    time: float  # since the output was opened [s]
    frame: int
    sentence: str

@final
class AudioBackend:
    """A sound system, available or not."""

    name: str
    available: bool
    sentence: str  # what it is, or why it is not available

@final
class JackCapture:
    """A JACK client that records another client from its first sound on, at most `n_frames` frames.

    Raises EngineError.
    """

    def __new__(cls, name: str, n_channels: int, n_frames: int) -> Self: ...
    recorded: int  # frames so far
    def connect(self, source: str, limit: float) -> bool:
        """Connect to the outputs of client `source`, waiting up to `limit` [s]; whether all are
        connected.
        """
    def freewheel(self, on: bool) -> bool:
        """Let the server run as fast as its clients, or by its clock again; whether it agreed."""
    def finish(self) -> NDArray[np.float32]:
        """End the recording; its frames, (n_frames, n_channels)."""

def play_frames(frames: NDArray[np.float32], rate: int, spec: str = "auto") -> str:
    """Play frames (n_frames, n_channels) at `rate` [Hz] to their end; the output as a sentence.

    Raises EngineError.
    """

def survey_audio() -> list[AudioBackend]:
    """Every sound system that ergon knows; starts no server."""

# --- live ---------------------------------------------------------------------------------------

@final
class HandStatus:
    """The state of a hand of a performance."""

    position: float  # of the key [m]
    force: float  # of the piece on the key [N]
    sent: float  # to the motor, after the safety stages [N]
    scale: float  # factor of the piece's force, 0 to 1
    real: bool  # a person moves the key, not its stand-in
    touch: bool  # a finger is on the key
    enabled: bool  # the device lets forces through
    tripped: bool  # forces are held at zero
    hot: bool  # the board reports that the motor is too hot
    let_go: int  # how often the board reported that it had let go
    stalls: int  # how often the force ended because the host was stopped

@final
class Status:
    """The state of a performance."""

    frame: int  # frames computed
    ticks: int
    late: int  # ticks that began more than half a tick late
    latest: float  # greatest lateness of a tick [s]
    lost: int  # how often the clock was reset, because it was too late
    dropped: int  # frames that found no room in the ring
    missed: int  # frames of frozen parts that were not read in time
    load: float  # computing time over the length of a tick, mean of the last second
    busiest: float  # greatest load of one tick
    filled: int  # frames in the ring
    underruns: int
    input_gaps: int  # how often frames of the sound input were missing
    xruns: int  # late cycles that the server, the card or the silent clock reported
    played: int  # frames that went to the card
    alive: bool  # a card or server takes frames
    done: bool  # the physics thread has ended
    panicked: bool  # silence was asked for
    sounding: float | None  # time since frame 0 went to the card [s], by the time of the last block
    latency: float  # from the card to the ear [s]
    paced: bool  # the output has a clock
    peaks: list[float]  # of each channel that is heard, decaying
    hands: list[HandStatus]

@final
class HandLimit:
    """How much of the piece's force a real hand may get, so that device and piece stay stable."""

    hand: int
    scale: float  # factor of the force, 0 to 1
    stiffness: float  # greatest stiffness of piece and guidance [N/m]
    limit: float  # greatest stable stiffness [N/m]

class GuidanceSpring(NamedTuple):
    """The spring K [N/m] and damper Z [N·s/m] that guide a hand, by steps or always."""

    K: float
    Z: float
    follows_steps: bool

class LiveHand(NamedTuple):
    """A hand of a performance."""

    standin: _Floats  # position at each tick while no person plays [m], (n_ticks,)
    reach: float  # factor between key and piece
    guidance: GuidanceSpring | tuple[float, float, bool] | None
    response: _Floats  # ReachableNetwork.response of the piece, (n_ticks,), or empty
    # Of the key as measured: mass [kg], damping [N·s/m] and, if known, delay [s].
    measured: tuple[float, float, float | None] | None
    forces: _Floats  # that drive the key along `standin` [N], (n_ticks,), or empty

class AxisCalibration(NamedTuple):
    """The calibration of an axis of a device; its units are m or rad."""

    number: int
    sign: float  # 1 or -1
    zero: float  # reading at position 0
    gain: float  # metres per unit of the reading
    range: tuple[float, float]
    force_max: float  # [N]

class LiveBoard(NamedTuple):
    """A device of a performance."""

    url: str
    axes: Sequence[tuple[int, int]]  # (axis, index of the hand)
    force_max: float | None  # greatest force [N]
    calibration: Sequence[AxisCalibration]

class RecordTarget(NamedTuple):
    """The file in which a performance records its hands."""

    path: Path
    axes: Sequence[RecordedAxis | tuple[str, str]]
    about: str  # JSON

class FrozenStem(NamedTuple):
    """A frozen part of a performance: outputs that are read from a file."""

    path: Path
    offset: int  # where its doubles begin [bytes]
    n_frames: int
    outputs: Sequence[int]

class PerformanceEvent(NamedTuple):
    """An event of a performance.

    The number is a board ("gone", "back"), a hand ("took over", "tripped: …"), a ticket ("changed",
    "late", "acted", "missed") or a time [s] ("lost"); 0 for "muted", "finer", "gained"
    and "ended".
    """

    frame: int
    what: str
    number: float

class SoundEvent(NamedTuple):
    """An event of a performance's sound output or input, at a time since it was opened [s]."""

    time: float
    sentence: str

class SoundInput(NamedTuple):
    """The sound input of a performance."""

    sentence: str  # the input, or why there is none; empty if the piece has no inputs
    live: bool  # a sound card is open as input
    gaps: int  # how often frames were missing
    missing: int  # frames of silence in their place
    discarded: int  # frames in excess
    recorded: int | None  # frames in the file of the input; None: no file
    lost: int  # of `recorded`: silence, because the disk was too slow
    error: str | None  # why the file could not be written

class SilenceEdge(NamedTuple):
    """A frame at which the silence of a panic begins or ends.

    From a frame at which the silence begins, the sound falls within 5 ms; from a frame at which
    it ends, the sound rises within 2 ms.
    """

    frame: int
    begins: bool

@final
class AudioRecorded:
    """The state of a sound file that is being recorded."""

    first: int | None  # frame of the performance at which the file begins; None: not begun
    frames: int  # in the file so far
    missing: int  # of `frames`: silence, because the disk was too slow
    ended: bool  # the file is closed
    error: str | None  # why it could not be written

@final
class Performance:
    """Plays a piece live: one real-time thread between devices and sound.

    After `close` every method but `panic`, `release`, `stop` and `close` raises EngineError.
    """

    def __new__(
        cls,
        simulation: Simulation,
        mixer: Mixer,
        *,
        tick_frames: int = 64,
        audio: str = "auto",
        gain: float = 1.0,
        limit: float = 1.0,
        n_frames: int | None = None,
        fades_from: int | None = None,
        hands: Sequence[LiveHand] = ...,
        boards: Sequence[LiveBoard] = ...,
        bars: Sequence[int] = ...,
        ahead: int | None = None,
        record: RecordTarget | None = None,
        frozen: Sequence[FrozenStem] = ...,
        fold: Fold | None = None,
        seen: bool = False,
        audio_in: str = "auto",
        record_in: Path | None = None,
    ) -> Self:
        """Begin to play a copy of the simulation, through a copy of the mixer and of the fold.

        `tick_frames`: frames of a tick.
        `limit`: ceiling of the limiter.
        `n_frames`: length of the piece; None: until `stop`.
        `fades_from`: the performance also ends once the sound has faded after this many frames
        (see SilenceDetector).
        `ahead`: frames of the ring.
        `bars`: frames at which a hand that comes back takes over.
        `fold`: from the mixer's channels to those that are heard.
        `seen`: pages will see the performance (`ViewServer.show`).
        `audio_in`: the sound input, "auto" (that of the output, if it has one), "jack[:PORTS]",
        "pulse[:SOURCE]" or "none".
        `record_in`: a new WAVE file of the sound input.

        Raises EngineError.
        """
    def status(self) -> Status:
        """The state now."""
    def events(self) -> list[PerformanceEvent]:
        """Events since the last call."""
    def sound_events(self) -> list[SoundEvent]:
        """Events of the sound output and input so far."""
    def silences(self, since: int) -> list[SilenceEdge]:
        """Edges of the silence of panics, from number `since` on.

        The latest 256 edges are kept. Raises EngineError when the performance is closed.
        """
    def hand_limit(self, hand: int, response: _Floats) -> HandLimit | None:
        """The force limit of a real hand in another piece; None if the hand is not real.

        `response` (n_ticks,) [N/m] is what ReachableNetwork.response returns for that piece.
        Raises EngineError if the performance is closed.
        """
    def hand_limits(self) -> list[HandLimit]:
        """The force limit of each real hand in the piece that the performance began with.

        Raises EngineError if the performance is closed.
        """
    def output(self) -> str:
        """The sound output, as a sentence."""
    def sound_input(self) -> SoundInput:
        """The sound input, and what is missing of it."""
    def granted(self) -> str | None:
        """Priority and memory lock of the physics thread, in words; None until it runs."""
    def panic(self) -> None:
        """Silence within 5 ms and zero force at the next tick, until `release`."""
    def release(self) -> None:
        """Let sound and force return after `panic`, after `let_go` and after a trip."""
    def gain(self, gain: float) -> bool:
        """Let the gain glide to `gain` in 20 ms, from the next tick on; False if too many commands
        wait.
        """
    def record_audio(self, path: Path) -> None:
        """Write what is computed for the loudspeakers to a new WAV file, from the next tick on.

        Frames are 32-bit floats, the same as the back end gets; in a panic they are zeros.
        Raises EngineError if the file exists or another one is being written.
        """
    def end_audio(self) -> bool:
        """End the file of `record_audio`; False if too many commands wait."""
    def audio_recorded(self) -> AudioRecorded | None:
        """The state of the file of `record_audio`; None if there was none."""
    def strike(self, point: int, impulse: float) -> int | None:
        """Strike a point of the simulation that plays by an impulse [N·s], at the next tick.

        Returns a ticket, or None if too many commands wait. An event "acted" with the ticket
        tells the frame; an event "missed" says that nothing was struck, because the simulation
        lacks the point or too many strikes came at once. Raises EngineError.
        """
    def tell(self, number: int, value: float) -> int | None:
        """Let an input of Timeline.controlled_input go to a value, full scale 1, at the next tick.

        Returns a ticket, as `strike`. Raises EngineError.
        """
    def part_gain(self, group: int, gain: float) -> bool:
        """Let the gain of a group of the mixer's routes glide in 20 ms; False if too many commands
        wait.
        """
    def change(
        self,
        frame: int,
        *,
        simulation: Simulation | None = None,
        old: Simulation | None = None,
        mixer: Mixer | None = None,
        gains: Sequence[tuple[int, float]] = ...,
        gain: float | None = None,
        bars: Sequence[int] | None = None,
        standins: Sequence[_Floats] | None = None,
        forces: Sequence[_Floats] = ...,
        guidance: Sequence[Sequence[tuple[int, float, float]]] | None = None,
        bounds: Sequence[Sequence[tuple[int, float]]] | None = None,
        damp: float | None = None,
    ) -> int:
        """Make a change at `frame`, the first of a tick; returns a ticket. Arguments that are
        None change nothing.

        An event "changed" with the ticket confirms the change; an event "late" says that nothing
        was changed, because the frame had passed, another simulation than `old` was playing, or
        it was revoked.

        `simulation`, whose `start` is `frame`, takes over from `old`, a simulation by the plan that
        plays until then; without `old` it begins anew. `mixer` takes gains and filters over.
        `gains` are (group, gain). `standins`: for each hand new stand-in positions from this
        tick on [m], (n_ticks,); an empty array keeps the old ones. `forces`: for each hand the
        forces that drive its key along them [N]. `guidance`: for each hand (ticks after the
        change, factor of K, factor of Z). `bounds`: for each hand (ticks after the change,
        greatest factor of the piece's force); the force falls before a lower bound and rises
        after a higher one. `damp`: as in Simulation.damp; 0 removes it. Raises
        EngineError.
        """
    def revoke(self, frame: int) -> None:
        """Withdraw the changes of the simulation that are due at `frame` or later and were not made
        yet.

        An event "late" reports each of them, by rising tickets; later changes stay. Raises
        EngineError if too many commands wait.
        """
    def stop(self) -> None:
        """Stop: zero force at once, silence within 5 ms."""
    def wait(self, seconds: float) -> bool:
        """Wait until the last frame is computed; False if `seconds` pass first."""
    def recording_trouble(self) -> str | None:
        """Why the recording cannot be written at present; None if it can, or if there is none."""
    def close(self, patience: float) -> list[PerformanceEvent]:
        """Wait up to `patience` [s] until everything was heard, and close; returns the remaining
        events.

        Raises EngineError if a file could not be written or the physics thread panicked.
        """

# --- devices ------------------------------------------------------------------------------------

def stop_on_signals(signals: Sequence[int], *, ends: bool | None) -> None:
    """Let signals act at once, before their Python handlers run.

    `ends` True: they stop every force and sound; False: every force; None: nothing. Call it again
    after each signal.signal, which replaces the core's handler.
    """

def let_go() -> None:
    """Set every force of the process to zero, until Performance.release."""

def has_let_go() -> bool:
    """Whether every force is zero, by `let_go` or by a signal."""

def begin_again() -> None:
    """Allow forces and sound again, in a process that continues after a signal."""

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
    model: _Floats | None = None,
    network: tuple[Network, int, float, float] | None = None,
    noise: float = 0.0,
    force_step: float = 0.0,
    seed: int = 0,
    seconds: float | None = None,
    once: bool = False,
) -> None:
    """Emulate a device of `axes` keys on 127.0.0.1 until Ctrl-C, or for `seconds` [s].

    A key has mass [kg], stiffness [N/m], damping [N·s/m] and travel [m]; its motor has force_max
    [N], its sensor a resolution [m]. `rate` [Hz] is that of the device's periods. `hand` is the
    stiffness [N/m] and damping [N·s/m] of hands, which follow `paths`, each (n,) [m] by period;
    an empty path is a resting finger, a missing one an untouched key. With `model`, the
    parameters of `key_path`, each key moves by that model instead. With `network` (network,
    index of a MAT, constant force [N], delay of the motor [s]), each key moves as the key of a
    score whose MAT of that index takes the forces. `noise` [m] is the standard deviation of the
    sensor's noise, drawn by `seed`; forces
    are rounded to multiples of `force_step` [N].

    `tell(event, text)` is called with "ready" and the address, "let-go" (no packet for
    `watchdog` [s]), "host-gone", and "over" with periods, packets and the hash of all positions;
    "over" also comes after Ctrl-C. Raises EngineError, and what `tell` raises.
    """

def guard_haply() -> None:
    """Run as the guardian process of a Haply, until the host at the standard input is gone.

    The guardian holds the connection to the Haply service, and sets forces to zero if the host
    is silent or stopped. Raises EngineError if the standard input is not a host.
    """

@final
class UsbBoard:
    """What a USB board reports about itself."""

    vendor: int
    product: int
    name: str
    serial: str

@final
class SerialPort:
    """A serial port of this machine."""

    path: str
    usb: UsbBoard | None  # None: not on USB

def serial_ports() -> list[SerialPort]:
    """Every serial port of this machine."""

def serial_identity(path: str) -> str | None:
    """A name of the board on a serial port that does not depend on the port; None if unknown."""

def checkup(seconds: float, period: float) -> Checkup:
    """Wake like the physics thread every `period` [s] for `seconds` [s]. Raises EngineError."""

@final
class Device:
    """An open device, for tests and calibration. A closed one raises EngineError."""

    def __new__(cls, url: str, calibration: Sequence[AxisCalibration] = ...) -> Self:
        """Open the device. Raises EngineError if it does not answer."""
    axes: int
    unit: str  # of positions, m or rad
    resolution: float  # step of the position sensor [m or rad]
    range: Range
    force_max: float  # [N or N·m]
    force_continuous: float  # force that its motors bear for hours [N or N·m]
    touch_gated: bool  # whether it gives force only while a finger touches it
    lockstep: bool
    def direction(self, axis: int, period: float) -> float:
        """The sign of an axis, found by a small force, in ticks of `period` [s]: 1 or -1.

        Raises UnsureError if the axis did not move, or moved the same way for both signs.
        """
    def directions(self, axes: Sequence[int], period: float) -> list[float | None]:
        """The signs of several axes, which are pushed at the same time; None of an axis that did
        not move, or moved the same way for both signs.
        """
    def ends(self, seconds: float, period: float) -> _Floats:
        """Least and greatest position of each axis during `seconds` [s] of motion by hand, (n_axes,
        2) [m or rad].
        """
    def checkup(self, seconds: float, period: float) -> Checkup:
        """Send zero forces every `period` [s] for `seconds` [s], and time the replies."""
    def close(self) -> None:
        """Close the device; forces are zero."""

def excite(
    device: Device,
    axis: int,
    force: _Floats,
    rate: float,
    frames_per_tick: int,
    guide: tuple[float, float, tuple[float, float], tuple[float, float], float],
    *,
    sign: int = 1,
    unguided_ticks: int = 0,
    force_step: float = 0.0,
    tells_touch: bool = True,
    is_gated: bool = True,
    record: RecordTarget | None = None,
) -> ExcitationRecord:
    """Push an axis by forces (n_ticks,) [N], then let go of it; a tick is `frames_per_tick`.

    `guide`: (centre, where the key is kept [m]; distance from there to the nearer end [m];
    stiffness [N/m] and damping [N·s/m] of the guide; the same of the brake; deceleration [m/s²]
    that the brake surely reaches). The guide pulls after the first `unguided_ticks`; the brake
    replaces the forces beyond 0.6 of the way to an end. `sign` is -1 for a motor that pushes the
    other way round. `force_step` [N] is the step of the motor's force, if the wire does not tell
    it. With `tells_touch` a touch ends the take; with `is_gated` a device that lets no force
    through ends it.

    Every force passes the safety stages of a performance; only the slew limit and the rises are
    off. Raises EngineError if the axis does not exist, OSError if the file of `record` cannot be
    written.
    """

@final
class ExcitationRecord:
    """The record of a key that `excite` pushed: its ticks as columns, and why they ended."""

    end: str
    """done, touched, gate closed, not finite, unplugged, silent, shared, stopped, or a trip."""
    def requested_forces(self) -> _Floats:
        """Forces that were asked for, with those of guide and brake (n,) [N]."""
    def sent(self) -> _Floats:
        """Forces as they went over the wire, after all safety stages (n,) [N]."""
    def positions(self) -> _Floats:
        """Positions of the replies to the forces (n,) [m]; without a reply the position before."""
    def are_fresh(self) -> NDArray[np.bool_]:
        """Whether there was a reply to each force (n,)."""
    def clocks(self) -> NDArray[np.uint32]:
        """The device's clock in each reply (n,) [µs]; 0 if it has none."""
    def braked(self) -> NDArray[np.bool_]:
        """Whether the brake pushed instead of the written force (n,)."""

def emulated_device(
    protocol: Literal["firefader", "frame"],
    model: _Floats,
    *,
    rate: float,
    travel: float = 0.1,
    force_max: float = 20.0,
    resolution: float = 0.0,
    noise: float = 0.0,
    force_step: float = 0.0,
    seed: int = 0,
    path: _Floats | None = None,
    hand: tuple[float, float] = ...,
    touch_gate: bool = False,
    seconds: float | None = None,
    calibration: Sequence[AxisCalibration] = ...,
) -> Device:
    """An emulated device in this process, in lockstep, behind the driver of its protocol.

    Its keys move by `model`, the parameters of `key_path`; `rate` [Hz] is that of its periods;
    lengths are in m, forces in N. `path` [m] (n_periods,) is that of a hand that pulls the key
    by `hand`, a spring [N/m] and a damper [N·s/m]. After `seconds` the device is gone. Raises
    EngineError if the device is impossible.
    """

def measure_faults() -> list[FaultMeasurement]:
    """Make every fault on every emulated device, in virtual time: some seconds of computing.

    Raises EngineError if an emulator does not answer its own driver.
    """

@final
class FaultMeasurement:
    """One fault on an emulated device: how soon its force is zero, and its greatest force."""

    fault: str  # in words
    device: str  # the kind of device, as in a URL
    seconds: float | None  # from the fault to zero force [s]; None: force stays on, or excluded
    bound: float | None  # the longest that is allowed [s]; None: no bound is set
    excluded: str | None  # why the fault is not made on this device
    unbounded: str | None  # why no bound is set
    force: float  # greatest force from the fault on [N]
    rise: float  # fastest growth of the force from the fault on [N/ms]
    exceeds: bool  # time, force or growth is beyond its bound

@final
class Checkup:
    """Timings that `checkup` measured."""

    priority: int | None  # under SCHED_FIFO; None: no real-time priority
    locked: bool  # memory stays in RAM
    seconds: float
    unanswered: int  # forces without a reply within 20 ms
    garbage: int  # received bytes that belong to no packet
    drift_ppm: float | None  # how much faster the device's clock runs than the host's [1e-6]
    def lateness(self) -> _Floats:
        """Lateness of each tick [s], (n_ticks,); empty in lockstep."""
    def round_trips(self) -> _Floats:
        """Time from each force to its reply [s], (n_replies,)."""
