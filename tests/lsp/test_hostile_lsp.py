"""What comes to the language server and is no message that it handles: an answer, or the end."""

from __future__ import annotations

import io
import json
import resource
from pathlib import Path
from typing import Any

import pytest
from commands import forked
from lsp_messages import END, INITIALIZE, URI, framed, notified, opened, requested

from ergon.workshop.lsp.guard import GuardedInput, ProtocolError
from ergon.workshop.lsp.server import _HANDLERS

HOVER = "textDocument/hover"
POSITION = {"line": 0, "character": 0}


def answers(data: bytes) -> list[dict[str, Any]]:
    """The messages in what a server wrote."""
    result = []
    while data:
        head, _, rest = data.partition(b"\r\n\r\n")
        length = int(head.partition(b"Content-Length: ")[2].partition(b"\r\n")[0])
        result.append(json.loads(rest[:length]))
        data = rest[length:]
    return result


def guarded(*messages: object) -> tuple[list[dict[str, Any]], list[dict[str, Any]], GuardedInput]:
    """The messages that are handed on, the answers of the guard, and the guard."""
    output = io.BytesIO()
    guard = GuardedInput(io.BytesIO(b"".join(map(framed, messages))), output, _HANDLERS.keys())
    handed = []
    while line := guard.readline():
        assert guard.readline() == b"\r\n"
        handed.append(json.loads(guard.read(int(line.partition(b": ")[2]))))
    return handed, answers(output.getvalue()), guard


@pytest.mark.parametrize(
    ("message", "code", "words"),
    [
        (b"[" * 100_000, -32700, "nested too deeply"),
        (b"{", -32700, "not JSON"),
        (b'{"jsonrpc": "2.0", "id": 2, "method": "\\ud800"}', -32700, "half of a character"),
        (b"9" * 5000, -32700, "too many digits"),
        ([INITIALIZE], -32600, "must be a JSON object"),
        ({"jsonrpc": "1.0", "id": 2, "method": HOVER}, -32600, "2.0"),
        ({"jsonrpc": "2.0", "id": [2], "method": HOVER}, -32600, "an id is"),
        ({"jsonrpc": "2.0", "id": 2, "method": {"a": 1}}, -32601, "is not done"),
        (requested(2, "workspace/executeCommand", command="x"), -32601, "is not done"),
        (requested(2, HOVER, position={"line": -1, "character": 0}), -32602, "position"),
        (requested(2, HOVER), -32602, "required field missing"),
        (requested(2, HOVER, uri="file:///dev/zero", position=POSITION), -32602, "is not open"),
        (
            requested(2, HOVER, position=POSITION, more=json.loads("[" * 100 + "]" * 100)),
            -32600,
            "deep",
        ),
        (INITIALIZE, -32600, "comes once"),
        (requested(2, "textDocument/didChange"), -32600, "if, and only if"),
    ],
)
def test_refused_messages_get_error_answers(message: object, code: int, words: str):
    handed, (answer,), guard = guarded(INITIALIZE, opened("x"), message, *END)
    assert [one["method"] for one in handed] == [
        "initialize",
        "textDocument/didOpen",
        "shutdown",
        "exit",
    ]
    assert answer["error"]["code"] == code
    assert words in answer["error"]["message"]
    assert guard.failure is None


def test_requests_before_initialize_and_after_shutdown():
    handed, (early, late), _ = guarded(
        requested(1, HOVER, position=POSITION),
        INITIALIZE,
        END[0],
        requested(2, HOVER, position=POSITION),
    )
    assert [one["method"] for one in handed] == ["initialize", "shutdown"]
    assert (early["id"], early["error"]["code"]) == (1, -32002)
    assert (late["id"], late["error"]["message"]) == (2, "the server was shut down")


def test_refused_notifications_get_no_answer():
    wrong = (
        notified("textDocument/didChange", contentChanges=[{"text": "y"}], uri="file:///b.yaml"),
        notified("textDocument/didChange", contentChanges=7),
        notified("$/strange"),
        {"jsonrpc": "2.0", "id": 3, "result": None},
    )
    handed, text, _ = guarded(INITIALIZE, *wrong)
    assert len(handed) == 1
    assert text == []


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"Content-Length: 100000000000\r\n\r\n{}", "100,000,000,000 bytes is announced"),
        (b"Content-Length: 1" + b"0" * 30 + b"\r\n\r\n{}", "must begin with"),
        (b"Content-Length: 10\r\n\r\n{}", "ends within a message"),
        (b"GET / HTTP/1.1\r\n\r\n", "such as Content-Length"),
        (b"\r\n", "must begin with"),
        (b"a: " + b"b" * 10_000, "must have lines"),
        (b"a: b\r\n" * 100, "must begin with"),
    ],
)
def test_malformed_frames_end_the_server(data: bytes, words: str):
    output = io.BytesIO()
    guard = GuardedInput(io.BytesIO(framed(INITIALIZE) + data), output, _HANDLERS.keys())
    while guard.readline():
        pass
    assert isinstance(guard.failure, ProtocolError)
    assert words in str(guard.failure)
    (answer,) = answers(output.getvalue())
    assert (answer["id"], answer["error"]["code"]) == (None, -32600)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (requested(2, HOVER, position={"line": -1, "character": 0}), 0),
        (requested(2, "textDocument/completion", position=POSITION), 0),
        (b"[" * 100_000, 0),
        (b"", 2),
    ],
)
def test_lsp_process_ends_without_traceback(tmp_path: Path, message: object, code: int):
    """It ended with one even where all was well, for pygls closes stdout."""
    data = b"".join(map(framed, [INITIALIZE, opened(""), message, *END]))
    if code:
        data = b"Content-Length: 100000000000\r\n\r\n{}"
    limits = ((resource.RLIMIT_AS, 4 << 30),)
    done = forked(["lsp"], tmp_path, lines=data.decode(), limits=limits)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    if code:
        assert "100,000,000,000 bytes" in done.stderr
        return
    assert done.stderr == ""
    assert '"result": null' in done.stdout
    assert URI in done.stdout


@pytest.mark.parametrize(("end", "code"), [(END, 0), (END[1:], 1)])
def test_lsp_exit_code_by_shutdown(tmp_path: Path, end: tuple[object, ...], code: int):
    done = forked(["lsp"], tmp_path, lines=b"".join(map(framed, [INITIALIZE, *end])).decode())
    assert (done.returncode, done.stderr) == (code, "")
