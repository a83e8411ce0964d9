"""What a second user of this machine reaches of commands that run, under a umask that forbids
nothing: workers, OSC, pages, and the files that are kept.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from commands import ERGON
from patience import PATIENCE, until
from second_user import as_second_user, needs_root

pytestmark = needs_root

SCORE = """\
ergon: 1
rates: {audio: 8000Hz}
accuracy: {method: ca}
instruments:
  a: {modules: {p: {PLATE: {shape: hex, radius: 5, M: 50g, f: 300Hz, t60: 1s,
    hardening: 1e9N/m3}}}, out: {x: {SOX: p.3}}}
strikes: {s: {to: [a.p.centre], at: 0.1s, impulse: 1mNs}}
render: {tail: TAIL, bits: float}
"""


@contextlib.contextmanager
def running(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """A command of which all is in a folder that everybody may enter, under umask 000."""
    environment = {
        **os.environ,
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
        "ERGON_CACHE": "",
    }
    for name in ("XDG_CACHE_HOME", "XDG_RUNTIME_DIR", "XDG_STATE_HOME", "ERGON_OSC_KEY"):
        environment.pop(name, None)
    with subprocess.Popen(
        [*ERGON, *words],
        cwd=folder,
        env=environment,
        umask=0,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.wait(PATIENCE)


@pytest.fixture
def folder(short_folder: Path) -> Path:
    short_folder.chmod(0o755)
    (short_folder / "home").mkdir()
    (short_folder / "tmp").mkdir()
    (short_folder / "tmp").chmod(0o1777)
    (short_folder / "s.yaml").write_text(SCORE.replace("TAIL", "1s"))
    (short_folder / "long.yaml").write_text(SCORE.replace("TAIL", "36000s"))
    return short_folder


# --- workers --------------------------------------------------------------------------------------


def ports_of(process: subprocess.Popen[str]) -> set[tuple[int, int]]:
    """(process, port) of all that listens below a command."""
    import psutil

    command = psutil.Process(process.pid)
    rows = set()
    for member in (command, *command.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            rows |= {
                (member.pid, row.laddr.port)
                for row in member.net_connections("inet")
                if row.status == psutil.CONN_LISTEN
            }
    return rows


# What a port says to who connects or asks for a page: plainly, by TLS, with another certificate.
_FOREIGN = """
security = distributed.Security.temporary()
foreign = security.get_connection_args("client")["ssl_context"]
"""
_ASK = """
nobody = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
nobody.check_hostname, nobody.verify_mode = False, ssl.CERT_NONE
foreign.check_hostname, foreign.verify_mode = False, ssl.CERT_NONE
def answer(port, context, asked):
    try:
        with socket.create_connection(("127.0.0.1", port), 5) as plain:
            with (context.wrap_socket(plain) if context else plain) as channel:
                channel.settimeout(1)
                if asked:
                    channel.sendall(asked)
                try:
                    return channel.recv(1000).hex()
                except TimeoutError:
                    return ""
    except OSError:
        return ""
page = b"GET /health HTTP/1.0\\r\\n\\r\\n"
print(json.dumps({port: [answer(int(port), context, asked) for context, asked in
    ((None, b""), (None, page), (nobody, b""), (nobody, page), (foreign, b""), (foreign, page))]
    for port in sys.argv[1:]}))
"""


def test_local_workers_reject_second_user(folder: Path):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with running(folder, "render", "long.yaml", "--on", "local:2", "-o", "x.wav", "-q") as process:
        # The scheduler and two nannies are threads of the command, the workers processes of it.
        until(lambda: len({pid for pid, _ in ports_of(process)}) == 3, "two workers")
        stretches = folder / "home" / ".cache" / "ergon" / "stretches"
        until(lambda: any(stretches.glob("*.stretch")), "work that is shared")
        ports = {port for _, port in ports_of(process)}
        assert len(ports) >= 5
        imports = "json, socket, ssl, distributed"
        answers = as_second_user(_ASK, *ports, imports=imports, before=_FOREIGN)
        assert set(answers) == {str(port) for port in ports}
        alert = "15"  # the type of a TLS record that tells why the connection ends
        for port, texts in answers.items():
            assert all(not text or text.startswith(alert) for text in texts), (port, texts)
        assert process.poll() is None
        assert open_to_others(folder) == []


# --- OSC and pages --------------------------------------------------------------------------------

_FETCH = """
rows = {}
for path in ("/", "/motion", "/live", "/sound.wav", "/" + "0" * 32 + "/motion"):
    with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as page:
        host = "Host: 127.0.0.1:" + sys.argv[1]
        page.sendall(("GET " + path + " HTTP/1.1\\r\\n" + host + "\\r\\n\\r\\n").encode())
        rows[path] = page.recv(12).decode()
print(json.dumps(rows))
"""
_SAY = """
port, *datagrams = sys.argv[1:]
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
    sender.bind(("127.0.0.1", 0))
    sender.settimeout(60)
    answers = []
    for datagram in datagrams:
        sender.sendto(bytes.fromhex(datagram), ("127.0.0.1", int(port)))
    answers.append(sender.recv(4096).decode(errors="replace"))
for datagram in datagrams:  # from sockets that nobody can look up
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(bytes.fromhex(datagram), ("127.0.0.1", int(port)))
print(json.dumps(answers))
"""


def events(process: subprocess.Popen[str], *names: str) -> list[dict[str, Any]]:
    """The first event of each name, in whatever order they come."""
    rows: dict[str, dict[str, Any]] = {}
    assert process.stdout is not None
    while len(rows) < len(names):
        line = process.stdout.readline()
        assert line, f"only {list(rows)} of {names}"
        row = json.loads(line)
        if row["event"] in names:
            rows[row["event"]] = row
    return [rows[name] for name in names]


def test_osc_and_pages_reject_second_user(folder: Path):
    from ergon.live.datagrams import encode_message

    words = ("--audio", "null", "--gain", "0dB", "--osc", "0", "--view", "--json")
    with running(folder, "play", "long.yaml", *words) as process:
        view, osc = events(process, "view", "osc")
        port = osc["port"]
        place = view["url"].removeprefix("http://127.0.0.1:").split("/")[0]
        statuses = as_second_user(_FETCH, place, imports="json, socket")
        assert set(statuses.values()) == {"HTTP/1.1 404"}
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as player:
            player.settimeout(PATIENCE)
            player.bind(("127.0.0.1", 0))
            ask = encode_message("/ergon/gain", ["loud"])  # which is answered, and changes nothing
            player.sendto(ask, ("127.0.0.1", port))
            assert b"the argument has to be one number" in player.recv(4096)
            asked = [encode_message(f"/ergon/{what}", []) for what in ("stop", "panic", "release")]
            (answer,) = as_second_user(
                _SAY, port, *(datagram.hex() for datagram in asked), imports="json, socket"
            )
            assert "it belongs to another user" in answer
            player.sendto(ask, ("127.0.0.1", port))
            assert b"the argument has to be one number" in player.recv(4096)
            assert process.poll() is None
            assert open_to_others(folder) == []
            player.sendto(encode_message("/ergon/stop", []), ("127.0.0.1", port))
            assert process.wait(PATIENCE) == 0


# --- files ----------------------------------------------------------------------------------------

_LOOK = """
rows = []
for place, folders, files in os.walk(sys.argv[1]):
    for name in folders + files:
        path = os.path.join(place, name)
        if not os.path.islink(path) and not stat.S_ISVTX & os.stat(path).st_mode:
            rows += [path] * os.access(path, os.W_OK)
    for name in files:
        if place.startswith((sys.argv[1] + "/home", sys.argv[1] + "/tmp")):
            rows += [os.path.join(place, name)] * os.access(os.path.join(place, name), os.R_OK)
print(json.dumps(sorted(set(rows))))
"""


def open_to_others(folder: Path) -> list[str]:
    """What a second user may write in a folder, or read of what is kept and of temporary files."""
    rows: list[str] = as_second_user(_LOOK, folder, imports="json, stat")
    return rows


def test_open_to_others_lists_accessible_files(folder: Path):
    (folder / "home" / "open").write_text("")
    (folder / "home" / "open").chmod(0o604)
    (folder / "written").write_text("")
    (folder / "written").chmod(0o602)
    (folder / "home" / "closed").mkdir(mode=0o700)
    (folder / "home" / "closed" / "inside").write_text("")
    rows = [path.removeprefix(f"{folder}/") for path in open_to_others(folder)]
    assert rows == ["home/open", "written"]
