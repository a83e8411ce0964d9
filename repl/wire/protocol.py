"""The protocol between a session and its prompts: lines of JSON over a local socket.

The session sends the first line:

    {"ergon": 1, "version": "0.2.0", "prompt": 2, "score": "/a/duet.yaml", "journal": "/a/s.jsonl"}

`ergon` is the version of this protocol, and `prompt` the number of this prompt. If the prompt is
refused, the only line is {"error": "why"}. Then the prompt sends requests. Each has an id, a
whole number or a string, and its answer has the same id; answers may come in another order.

    {"id": 1, "do": "submit", "text": "tempo 72"}
    {"id": 1, "is": {"taken": true, "text": "ok 3|1", "try": null, "lines": [], "leaves": false}}

An invalid request is answered by {"id": 1, "error": "why"} and does nothing else. REQUESTS lists
the requests. Lines of all prompts are done one by one, in order of arrival; all other requests
are answered at once. The lines of one prompt and their replies are messages to the others.
A last line {"ended": "why"} says that the session has ended; if the connection closes without
it, the process of the session has ended.
"""

from __future__ import annotations

import json
import math
from typing import Any

from ergon.common.errors import ErgonError
from ergon.common.structured import MalformedTextError, parse_json
from ergon.repl.session_protocol import Reply, Sounding, State

PROTOCOL_VERSION = 1
MAX_LINE = 2_000_000  # bytes; any text that a prompt takes fits in with room to spare
MAX_TEXT = 200_000  # characters of a submission; in JSON each has 12 bytes at most
MAX_ID = 200  # characters; whole numbers are those that every JSON reader keeps exactly
_INTEGER_MAX = 1 << 53


class ProtocolError(ErgonError):
    """A line does not follow the protocol: one sentence."""


# The fields of each request and their types; each comment is the answer.
REQUEST_FIELDS: dict[str, dict[str, type]] = {
    "submit": {"text": str},  # a reply, when the line is done
    "state": {},  # as below
    "messages": {},  # sentences since the last call, for this prompt
    "sounding": {},  # as below: what has begun since the last call of this prompt
    "panic": {},  # true, and silence
    "let_go": {},  # true, and no force
    "cancel": {},  # whether a line of this prompt was being computed, which is dropped
    "complete": {"line": str, "cursor": int},  # [text, start, hint] each
    "tokens": {"line": str},  # [start, end, kind] each
    "is_whole": {"text": str},  # true or false
    "leave": {},  # true; this prompt goes, the session goes on
    "end": {},  # true; the session ends, for all
}

# Optional fields and their defaults.
OPTIONAL_FIELDS: dict[str, dict[str, bool]] = {"submit": {"releases": True}}


def encode(**fields: Any) -> bytes:
    """One line of JSON in ASCII, so that no Unicode character ends it early."""
    return json.dumps(fields, ensure_ascii=True, allow_nan=False).encode() + b"\n"


def decode_message(message_line: bytes) -> dict[str, Any]:
    """The fields of a line. Raises ProtocolError."""
    try:
        message_fields = parse_json(message_line)
    except MalformedTextError:
        raise ProtocolError("this line is not JSON") from None
    if not isinstance(message_fields, dict):
        raise ProtocolError("a line must be a JSON object: {...}")
    return message_fields


def read_request_id(fields: dict[str, Any]) -> int | str | None:
    """The id of a request, as its answer repeats it. Raises ProtocolError."""
    request_id = fields.get("id")
    if request_id is None:
        return None
    if type(request_id) is int and abs(request_id) <= _INTEGER_MAX:
        return request_id
    if isinstance(request_id, str) and len(request_id) <= MAX_ID:
        return request_id
    raise ProtocolError(f"an id must be a whole number, or a word of {MAX_ID} characters at most")


def parse_request(request_fields: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """The name of a request, and its fields. Raises ProtocolError."""
    request_name = request_fields.get("do")
    field_types = REQUEST_FIELDS.get(request_name) if isinstance(request_name, str) else None
    if not isinstance(request_name, str) or field_types is None:
        raise ProtocolError(f"unknown request; known are {', '.join(REQUEST_FIELDS)}")
    request_arguments = {}
    for field_name, field_type in field_types.items():
        field_value = request_fields.get(field_name)
        if type(field_value) is not field_type:  # bool is not int here
            raise ProtocolError(
                f"the field '{field_name}' of '{request_name}' must be of type "
                f"{field_type.__name__}"
            )
        if isinstance(field_value, str) and len(field_value) > MAX_TEXT:
            raise ProtocolError(too_long_message(field_value))
        request_arguments[field_name] = field_value
    for field_name, default in OPTIONAL_FIELDS.get(request_name, {}).items():
        request_arguments[field_name] = request_fields.get(field_name, default)
        if type(request_arguments[field_name]) is not bool:
            raise ProtocolError(
                f"the field '{field_name}' of '{request_name}' must be of type bool"
            )
    return request_name, request_arguments


def too_long_message(text: str) -> str:
    """Why a text is refused that is too long."""
    return f"this text has {len(text):,} characters; {MAX_TEXT:,} are the most"


def encode_reply(reply: Reply) -> dict[str, Any]:
    """A reply as JSON."""
    return {
        "taken": reply.taken,
        "text": reply.text,
        "try": reply.try_,
        "lines": list(reply.lines),
        "leaves": reply.leaves,
    }


def decode_reply(reply_data: Any) -> Reply:
    """A reply from JSON. Raises ProtocolError."""
    try:
        reply_lines = tuple(map(str, reply_data["lines"]))
        try_ = None if reply_data["try"] is None else str(reply_data["try"])
        return Reply(
            bool(reply_data["taken"]),
            str(reply_data["text"]),
            try_,
            reply_lines,
            bool(reply_data["leaves"]),
        )
    except (KeyError, TypeError):
        raise ProtocolError("the session's answer is not a reply") from None


_NUMBER_FIELDS = ("bar", "beat", "tempo", "load", "late")


def encode_state(session_state: State) -> dict[str, Any]:
    """A state as JSON; a level of -inf (silence) is null."""
    return {
        **{name: getattr(session_state, name) for name in _NUMBER_FIELDS},
        "playing": [list(pair) for pair in session_state.playing],
        "level": session_state.level if math.isfinite(session_state.level) else None,
        "quant": session_state.quant,
        "recording": session_state.recording,
        "panicked": session_state.panicked,
        **({"let_go": True} if session_state.let_go else {}),
        **({"troubles": list(session_state.troubles)} if session_state.troubles else {}),
        **({"drawing": list(session_state.drawing)} if session_state.drawing else {}),
    }


def decode_state(state_data: Any) -> State:
    """A state from JSON. Raises ProtocolError."""
    try:
        return State(
            bar=int(state_data["bar"]),
            beat=float(state_data["beat"]),
            tempo=float(state_data["tempo"]),
            playing=tuple(
                (str(player), str(played_name)) for player, played_name in state_data["playing"]
            ),
            load=float(state_data["load"]),
            late=int(state_data["late"]),
            level=-math.inf if state_data["level"] is None else float(state_data["level"]),
            quant=str(state_data["quant"]),
            recording=None if state_data["recording"] is None else float(state_data["recording"]),
            panicked=bool(state_data["panicked"]),
            let_go=bool(state_data.get("let_go")),
            troubles=tuple(map(str, state_data.get("troubles", ()))),
            drawing=tuple(map(str, state_data.get("drawing", ()))),
        )
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise ProtocolError("the session's answer is not a state") from None


def encode_sounding(sounding: Sounding) -> dict[str, Any]:
    """What has begun, as JSON: the present instant, and the places with their fields."""
    return {"now": sounding.now, "began": [place._asdict() for place in sounding.began]}
