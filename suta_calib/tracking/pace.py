"""How many a second, lately."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

_WINDOW_S: Final = 1.5


class Pace:
    """Counts a second over the last second or two, from whenever it is asked.

    Args:
        count: a number that only grows.
    """

    def __init__(self, count: Callable[[], int]) -> None:
        self._count = count
        self._seen: deque[tuple[float, int]] = deque([(time.perf_counter(), count())])

    def __call__(self) -> float:
        """Growth per second since the oldest look within the window."""
        now = time.perf_counter()
        self._seen.append((now, self._count()))
        while len(self._seen) > 2 and now - self._seen[0][0] > _WINDOW_S:
            self._seen.popleft()
        (then, before), (now, after) = self._seen[0], self._seen[-1]
        return (after - before) / max(now - then, 1e-9)
