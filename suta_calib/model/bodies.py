"""What the ends of a chain of a robot are called, beside those of its other chains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from suta_calib.model.parameters import End


@dataclass(frozen=True)
class Bodies:
    """What labels call the two ends of a chain, to tell those of several chains apart.

    Attributes:
        base, tip: put before the label of what stands in the base, or sits on the tip; empty for
            the only chain there is, and for the base of a robot's first chain.
        name: of the chain, as results call it; empty for the only one there is.
    """

    base: str = ""
    tip: str = ""
    name: str = ""

    def label(self, label: str, end: End) -> str:
        """The label of something at one end, such that no other end has the same."""
        body = self.tip if end == "tip" else self.base
        if not body:
            return label
        return body if label == "default" else f"{body}/{label}"


# The only chain there is.
ALONE: Final = Bodies()
