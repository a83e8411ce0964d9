"""What tests of the prompt share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from delayed_sessions import Delayed, delays

from tests.repl.test_repl_session import SCORE


@pytest.fixture
def delayed(tmp_path: Path) -> Iterator[Delayed]:
    """A session on a busy machine, in virtual time."""
    session = Delayed(SCORE, tmp_path)
    with delays(lambda: session):
        yield session
    session.close()
