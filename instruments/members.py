"""Reads the choice of members of a generator: `12`, `3..8`, `3..last`, `all`, `last`, `centre`."""

from __future__ import annotations

import re
from typing import Literal

from ergon.notation.text.errors import TextError, quote

PATTERN = r"(?:[0-9]{1,9}(?:\.\.(?:[0-9]{1,9}|last))?|all|last|centre)"
_MEMBERS = re.compile(PATTERN)


def parse_members(
    members_text: str, member_count: int, owner_name: str
) -> tuple[int | Literal["centre"], int]:
    """The first member that `members_text` names, and their number; `called` has `member_count`
    members.

    Raises TextError.
    """
    member_words: dict[str, tuple[int | Literal["centre"], int]] = {
        "all": (0, member_count),
        "last": (member_count - 1, 1),
        "centre": ("centre", 1),
    }
    if members_text in member_words:
        return member_words[members_text]
    if not _MEMBERS.fullmatch(members_text):
        raise TextError(
            f"{quote(members_text)} is not a choice of members; write 3, 3..8, 3..last, all, last "
            "or centre"
        )
    low, _, high = members_text.partition("..")
    first_member = int(low)
    last_member = member_count - 1 if high == "last" else int(high or low)
    if max(first_member, last_member) >= member_count:
        raise TextError(f"{owner_name} has members 0 to {member_count - 1:,}")
    if last_member < first_member:
        raise TextError(f"{members_text} runs downwards; write the lower number first")
    return first_member, last_member - first_member + 1
