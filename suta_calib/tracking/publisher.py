"""Where poses go."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Self

from suta_calib.tracking.pose import TrackedPose


class Publisher(ABC):
    """Takes poses and never makes the tracker wait.

    Attributes:
        name: what it is called in statistics.
        published: poses handed over.
        dropped: poses nobody could take in time.
    """

    name: str = ""

    def __init__(self) -> None:
        self.published = 0
        self.dropped = 0

    @abstractmethod
    def publish(self, pose: TrackedPose) -> None:
        """Hand one pose over, valid or not, and return at once."""

    @abstractmethod
    def close(self) -> None:
        """Finish what was begun; a second time does nothing."""

    def statistics(self) -> dict[str, Any]:
        """Counts for JSON."""
        return {"published": self.published, "dropped": self.dropped}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
