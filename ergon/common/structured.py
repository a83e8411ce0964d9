"""JSON and TOML under untrusted names: one error, whatever is wrong with the text.

The readers of the standard library raise more than they document: RecursionError for text that is
nested deeply, ValueError for numbers of thousands of digits.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

from ergon.common.errors import ErgonError

# A reader of TOML takes a time that grows with the square of the parts of a key: 32,000 take 16 s.
_LONG_KEY = re.compile(r"""(?:(?:[\w-]{1,64}|"[^"\n]{0,64}"|'[^'\n]{0,64}')[ \t]*\.[ \t]*){33}""")

# A whole number that no float holds (1e308) is beyond every field.
_LONG_NUMBER = re.compile(r"\d{309}")


class MalformedTextError(ErgonError, ValueError):
    """The text is not of the format; the message says why, without the name of the file."""


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text, of UTF-8 if it is given as bytes. Raises MalformedTextError."""
    return _parsed("JSON", _loads_json, text)


def parse_toml(text: str | bytes) -> dict[str, Any]:
    """The table of a TOML text, of UTF-8 if it is given as bytes. Raises MalformedTextError."""
    table: dict[str, Any] = _parsed("TOML", _loads_toml, text)
    return table


def _loads_json(text: str) -> Any:
    # The function makes reading slower, so it is given only where a number may be long.
    return json.loads(text, parse_int=_int if _LONG_NUMBER.search(text) else None)


def _int(digits: str) -> int:
    if len(digits) > 308:
        raise ValueError
    return int(digits)


def _loads_toml(toml_text: str) -> dict[str, Any]:
    import tomllib

    if _LONG_KEY.search(toml_text):
        raise MalformedTextError("this is not TOML that can be read: a key has more than 32 parts")
    return tomllib.loads(toml_text)


def _parsed(format: str, loads: Callable[[str], Any], text: str | bytes) -> Any:
    try:
        return loads(text.decode("utf-8-sig") if isinstance(text, bytes) else text)
    except MalformedTextError:
        raise
    except UnicodeDecodeError:
        failure_reason = "it is not text in UTF-8"
    except RecursionError:
        failure_reason = "it is nested too deeply"
    except ValueError as error:
        # `_int` raises ValueError itself; the errors of the readers have a place in the text.
        is_digit_limit = type(error) is ValueError
        failure_reason = "it has a number of too many digits" if is_digit_limit else str(error)
    raise MalformedTextError(f"this is not {format} that can be read: {failure_reason}")
