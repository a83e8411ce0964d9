"""JSON Schema (draft 7) for editors, made from the tables that the checker uses."""

from __future__ import annotations

from typing import Any

from ergon.scores.reading.sections import SCORE_RECORD

FORMAT = 1


def schema() -> dict[str, Any]:
    """The schema of a score, as plain values."""
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": f"ergon score, format {FORMAT}",
        "description": SCORE_RECORD.doc,
        **SCORE_RECORD.schema(),
    }
