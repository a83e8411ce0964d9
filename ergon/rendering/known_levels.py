"""What earlier renders measured of each instrument, which need not be mixed by itself again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import stretches
from .balance import Balance

if TYPE_CHECKING:
    from ergon.exchange.stretch_store import StretchStore


class KnownLevels:
    """Measures of instruments, by `keys`: hashes of all that each depends on up to the end of each
    stretch (n_stretches; n_instruments).
    """

    def __init__(self, store: StretchStore, keys: Sequence[Sequence[str]]) -> None:
        """Read nothing yet."""
        self._store, self._keys = store, keys

    def recall(self, balances: Sequence[Balance], stop: int) -> list[int]:
        """Give balances what is known of them up to frame `stop`; the numbers of the others."""
        index = (stop - 1) // stretches.STRETCH_FRAMES
        return [
            number
            for number, balance in enumerate(balances)
            if not any(self._give(balance, keys[number], stop) for keys in self._keys[index:])
        ]

    def put(self, balances: Sequence[Balance], numbers: Sequence[int], stop: int) -> None:
        """Store what was measured of some balances up to frame `stop`."""
        index = (stop - 1) // stretches.STRETCH_FRAMES
        for number in numbers:
            measured, key = balances[number].measured, self._keys[index][number]
            known_level = self._store.get(key)
            if known_level is None or len(known_level.sound) < measured.size:
                self._store.put(key, measured.reshape(-1), b"")

    def _give(self, balance: Balance, key: str, stop: int) -> bool:
        known_level = self._store.get(key)
        if known_level is None or len(known_level.sound) % balance.n_measures:
            return False
        return balance.recall(known_level.sound.reshape(-1, balance.n_measures), stop)
