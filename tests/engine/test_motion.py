"""Motion files beside the engine that moved, and beside a reader written from the page alone."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from motion_reader import CONTACT, CONTACTS, ERGON, ERGONS, FLIGHT, FLIGHTS, INDEX, STATE, Replica

from ergon import _core

RATE = 44_100.0
FPS = 60.0
SECONDS = 2.5


def scene(
    n_cells: int = 40, *, listened: bool = True
) -> tuple[_core.Network, _core.Timeline, list[tuple[float, int]]]:
    """Cells, a linear plate, a gong that stiffens and a hammer, and what strikes them (t, MAT).

    In discrete parts the network is the truth: stepping it as written is what a plan has to do.
    """
    rng = np.random.default_rng(11)
    net = _core.Network()
    m = RATE**2
    net.part("sky", ca_rate=RATE)
    f = 20.0 * 200.0 ** rng.random(n_cells)
    cells = [
        net.cel(f"c{i}", M=1e-3 * m, f=float(f[i]), t60=float(0.3 + 3 * rng.random()))
        for i in range(n_cells)
    ]
    net.part("plate", ca_rate=RATE)
    plate = net.plate("", shape="hex", radius=3, M=0.3 * m, f=180.0, t60=2.0, rim="fixed")
    net.part("gong", ca_rate=RATE)
    gong = net.plate(
        "", shape="hex", radius=3, M=0.3 * m, f=65.0, t60=3.0, rim="fixed", hardening=4e8
    )
    net.part("hammer", ca_rate=RATE)
    hammer = net.cel("h", M=0.1 * m, K=60.0 * 1.0, Z=0.5 * RATE, X0=-2e-3)
    net.but("beats", hammer, net.centre(gong), K=900.0, Z=0.1 * RATE, gap=1e-3)
    if listened:
        net.listen("sky", positions=[(cells[0], n_cells, 1.0)])
        net.listen("plate", positions=[(plate, net.count(plate), 1.0)])
        net.listen("gong", positions=[(gong + 3, 1, 1.0)])
    else:
        net.listen("one", positions=[(cells[0], 1, 1.0)])
    timeline = _core.Timeline(net, RATE)
    # Every cell is struck, most of them several times.
    which = np.concatenate([np.arange(n_cells), rng.integers(0, n_cells, 120 - n_cells)])
    times = rng.uniform(0.0, SECONDS, 120)
    blows = [(float(t), cells[int(i)]) for t, i in zip(times, which, strict=True)]
    blows += [(0.1 + 0.4 * i, plate + 7 + i) for i in range(5)]
    blows += [(0.05 + 0.7 * i, hammer) for i in range(3)]
    for t, mat in blows:
        size = 2e-2 if mat == hammer else 2e-3 if mat >= plate else 2e-6
        timeline.strike(mat, t, impulse=size * float(rng.choice([-1.0, 1.0])))
    return net, timeline, sorted(blows)


def film(
    net: _core.Network,
    timeline: _core.Timeline,
    plan: _core.Plan,
    *,
    threads: int = 1,
    seconds: float = SECONDS,
) -> tuple[bytes, np.ndarray]:
    """The motion file and the sound of a simulation."""
    simulation = _core.Simulation(net, timeline, plan=plan, threads=threads)
    look = _core.MotionLook(simulation)
    mats = look.mats()
    parts = [
        {
            "name": run.part,
            "first": run.first,
            "count": run.count,
            "kind": run.kind,
            "why": run.why,
            "modes": run.modes and dict(zip(("first", "count", "of"), run.modes, strict=True)),
        }
        for run in look.runs()
    ]
    about = {"fps": FPS, "points": len(mats), "modes": look.n_modes, "parts": parts}
    recorder = _core.MotionRecorder(
        simulation,
        look,
        timeline,
        manifest=json.dumps(about),
        places=np.array([[*net.position_of(mat), 0.0] for mat in mats]),
        keys=[],
        n_speakers=0,
        fps=FPS,
    )
    data, sound = [], []
    stop = int(seconds * RATE)
    while recorder.next <= stop:
        block = np.zeros((recorder.next - simulation.frame, simulation.n_out))
        simulation.process(block)
        sound.append(block)
        recorder.look(simulation)
        data.append(recorder.take())
    return b"".join([*data, recorder.finish()]), np.concatenate(sound)


@pytest.fixture(scope="module")
def filmed() -> tuple[bytes, _core.Network, _core.Timeline, list[tuple[float, int]]]:
    net, timeline, blows = scene()
    plan = _core.Plan(net, timeline, error_db=-120.0, seen=["sky", "plate", "gong", "hammer"])
    return film(net, timeline, plan)[0], net, timeline, blows


def test_motion_replica_near_engine_positions(filmed: tuple) -> None:
    """Free points and modes within 0.5 % of amplitude at 1,000 random instants."""
    data, net, timeline, _ = filmed
    replica = Replica(data)
    look_mats = _mats(net, replica)
    kinds = {part["kind"] for part in replica.manifest["parts"]}
    assert kinds == {"free", "modal", "sampled"}
    plain = _core.Simulation(net, timeline)
    rng = np.random.default_rng(5)
    frames = np.sort(rng.integers(1, int(SECONDS * RATE) - 735, 1000))
    rest = replica.places[3]
    truth = np.zeros((len(frames), len(rest)))
    for row, frame in zip(truth, frames, strict=True):
        plain.process(np.zeros((frame - plain.frame, plain.n_out)))
        row[:] = plain.positions()[look_mats] - rest
    seen = replica.displacements(frames / RATE)
    engine = _core_displacements(data, frames / RATE)
    for part in replica.manifest["parts"]:
        columns = slice(part["first"], part["first"] + part["count"])
        if part["kind"] == "sampled":
            continue
        # Of a point alone its columns amplitude; of a body that of its largest swing.
        is_free = part["kind"] == "free"
        wrong = np.abs(seen[:, columns] - truth[:, columns])
        swing = np.abs(truth[:, columns]).max(axis=0 if is_free else None)
        assert wrong.max() <= 0.005 * np.max(swing), part["name"]
        assert (wrong <= 0.005 * swing + 1e-12).mean() > 0.999, part["name"]
        assert np.abs(engine[:, columns] - seen[:, columns]).max() <= 1e-9 * np.max(swing) + 1e-15


def test_motion_frames_error_relative_to_amplitude(filmed: tuple) -> None:
    data, net, timeline, _ = filmed
    replica = Replica(data)
    mats = _mats(net, replica)
    plain = _core.Simulation(net, timeline)
    n_frames = int(SECONDS * FPS)
    instants = (np.arange(n_frames) * RATE / FPS + 0.5).astype(int)
    truth = []
    for frame in instants:
        plain.process(np.zeros((frame - plain.frame, plain.n_out)))
        truth.append(plain.positions()[mats] - replica.places[3])
    for number, (times, values) in replica.frames().items():
        part = replica.manifest["parts"][number]
        columns = slice(part["first"], part["first"] + part["count"])
        is_truth = np.array(truth)[:, columns]
        assert np.allclose(times[:n_frames], np.arange(n_frames) / FPS, atol=1e-6)
        amplitude = 0.5 * np.ptp(is_truth, axis=0)
        # The stated bound, and what the plan differs by.
        planned = 1e-4 * np.abs(is_truth).max()
        share = _core.motion_bound()["amplitude"]
        assert (np.abs(values[:n_frames] - is_truth) <= share * amplitude + planned).all()


def test_motion_flights_of_ergons_only(filmed: tuple) -> None:
    data, net, _, blows = filmed
    replica = Replica(data)
    mats = _mats(net, replica)
    points = {mat: index for index, mat in enumerate(mats)}
    output = [
        (t + float(e["dt"]), int(e["point"]))
        for t, all in replica.records(ERGONS, ERGON)
        for e in all
    ]
    assert len(output) == len(blows)
    for (t, point), (index, mat) in zip(sorted(output), blows, strict=True):
        assert math.isclose(t, index, abs_tol=1e-6)
        assert point == points[mat]
    # It is told at most a second, and at least a moment, before.
    assert all(
        0.0 <= float(e["dt"]) <= 1.1 for _, all in replica.records(ERGONS, ERGON) for e in all
    )
    free = [part for part in replica.manifest["parts"] if part["kind"] == "free"]
    n_free = sum(part["count"] for part in free)
    flights = [
        (t, int(number))
        for t, all in replica.records(FLIGHTS, FLIGHT)
        for number in all["number"]
        if number < n_free
    ]
    struck = {(points[mat], round(math.floor(t * RATE + 0.5) / RATE, 7)) for t, mat in blows}
    assert 0.85 * 120 <= len(flights) <= 120
    assert all((number, round(t, 7)) in struck for t, number in flights)


def test_motion_contacts_time_and_strength(filmed: tuple) -> None:
    data, _, _, _ = filmed
    touches = [
        (t + float(c["dt"]), float(c["force"]), int(c["contact"]))
        for t, all in Replica(data).records(CONTACTS, CONTACT)
        for c in all
    ]
    assert touches
    assert {contact for _, _, contact in touches} == {0}
    assert all(force != 0.0 and 0.05 < t < SECONDS for t, force, _ in touches)


def test_motion_file_and_sound_bytes_for_thread_counts() -> None:
    net, timeline, _ = scene(listened=False)
    listened = _core.Plan(net, timeline)
    blind = _core.Simulation(net, timeline, plan=listened)
    seen = _core.Plan(net, timeline, seen=["sky", "plate", "gong", "hammer"])
    assert seen.hash == listened.hash
    assert not listened.seen()
    assert seen.seen()
    first, sound = film(net, timeline, seen, seconds=1.2)
    silent = np.zeros_like(sound)
    blind.process(silent)
    assert sound.tobytes() == silent.tobytes()
    for threads in (2, 3):
        again, same = film(net, timeline, seen, threads=threads, seconds=1.2)
        assert same.tobytes() == sound.tobytes()
        assert again == first
    # Without, what nobody hears is told not to be computed.
    parts = Replica(film(net, timeline, listened, seconds=0.1)[0]).manifest["parts"]
    assert {(part["kind"], part["why"]) for part in parts} == {("free", None), ("none", "unheard")}


def test_motion_file_segments_and_index(filmed: tuple) -> None:
    data, *_ = filmed
    replica = Replica(data)
    states = [(t, at) for kind, t, _, at in replica.chunks if kind == STATE]
    kind, _, index, offset = replica.chunks[-1]
    assert kind == INDEX
    n, parts = np.frombuffer(index, "<u4", 2)
    assert (n, parts) == (len(states), len(replica.manifest["parts"]))
    rows = np.frombuffer(index, [("t", "<f8"), ("at", "<u8")], n, 16 + 4 * int(parts))
    assert [(float(t), int(byte)) for t, byte in rows] == states
    assert np.frombuffer(index[-8:], "<u8") == offset
    assert np.frombuffer(data[-12:-4], "<u8") == offset
    # From a key state on a reader knows all that one knows who has read from the beginning.
    t0, byte = states[1]
    head = next(at for kind, _, _, at in replica.chunks if kind == STATE)
    late = Replica(data[:head] + data[byte:])
    instants = t0 + np.array([0.0, 0.2, 0.71])
    all_there, from_there = replica.displacements(instants), late.displacements(instants)
    assert np.abs(all_there - from_there).max() == 0.0


def test_motion_file_cut_or_damaged_at_every_byte(tmp_path: Path) -> None:
    """At every byte, with every bit: what is read is a beginning of the whole, or refused."""
    net = _core.Network()
    net.part("a", ca_rate=RATE)
    bell = net.cel("b", M=1e-3 * RATE**2, f=300.0, t60=0.5)
    mass = net.cel("c", M=1e-3 * RATE**2, K=500.0, Z=0.1 * RATE)
    net.ref("r", mass, net.sol("s"), K=100.0, Z=0.0)
    net.listen("b", positions=[(bell, 2, 1.0)])
    timeline = _core.Timeline(net, RATE)
    timeline.strike(bell, 0.01, impulse=1e-6)
    timeline.strike(mass, 0.012, impulse=1e-4)
    data, _ = film(net, timeline, _core.Plan(net, timeline), seconds=0.05)
    path = tmp_path / "x.motion"
    complete = _open(path, data)
    assert complete is not None
    assert complete.is_whole
    assert not complete.is_cut
    known = [tuple(chunk) for chunk in complete.chunks()]
    begins = [at for _, _, _, at in Replica(data).chunks]  # those of a bundle begin with it
    ends = [next((at for at in begins if at > begin), len(data)) for begin in begins]
    tables = 4  # manifest, points, names, links
    for cut in range(len(data)):
        result = _open(path, data[:cut])
        n_whole = sum(end <= cut for end in ends)
        if n_whole < tables - 1:
            assert result is None
        elif result is not None:
            assert [tuple(chunk) for chunk in result.chunks()] == known[:n_whole]
            assert not result.is_whole
            assert result.is_cut == (cut not in (8, *ends))
        else:
            assert n_whole < tables
    for byte in range(len(data)):
        for bit in range(8):
            damaged = bytearray(data)
            damaged[byte] ^= 1 << bit
            if damaged[4] == 2:
                continue  # a file of format 2 then, which is read too
            result = _open(path, bytes(damaged))
            n_whole = sum(end <= byte for end in ends)
            if result is not None:
                assert [tuple(chunk) for chunk in result.chunks()] == known[:n_whole]
                assert not result.is_whole


def _open(path: Path, data: bytes) -> _core.Motion | None:
    path.write_bytes(data)
    try:
        return _core.read_motion(path)
    except _core.EngineError:
        return None


def _core_displacements(data: bytes, instants: np.ndarray) -> np.ndarray:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        motion = _open(Path(folder) / "x.motion", data)
        assert motion is not None
        return motion.displacements(instants.tolist())


def _mats(net: _core.Network, replica: Replica) -> list[int]:
    names = {net.name_of(mat): mat for mat in range(net.n_mat)}
    return [names[name] for name in replica.names]
