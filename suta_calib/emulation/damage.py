"""Bytes that do not arrive as they were sent."""

from __future__ import annotations

import numpy as np

from suta_calib.emulation.faults import Faults


class Damage:
    """Damages bytes at random, the same way for the same seed.

    Args:
        faults: shares of bytes that are corrupted, flipped and lost.
        seed: of the random numbers.
    """

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._random = np.random.default_rng([seed, 3])

    def __call__(self, data: bytes) -> bytes:
        """The bytes as they arrive."""
        if not self._faults.damages:
            return data
        received = np.frombuffer(data, dtype=np.uint8).copy()
        # Exclusive-or with anything but zero: a corrupted byte is never the right one by chance.
        self._change(received, self._faults.corrupt, self._random.integers(1, 256, len(data)))
        self._change(received, self._faults.flip, 1 << self._random.integers(0, 8, len(data)))
        kept = self._random.random(len(data)) >= self._faults.lose
        return received[kept].tobytes()

    def garbage(self, count: int) -> bytes:
        """Random bytes."""
        return self._random.bytes(count)

    def _change(self, data: np.ndarray, share: float, mask: np.ndarray) -> None:
        hit = self._random.random(len(data)) < share
        data[hit] ^= mask[hit].astype(np.uint8)
