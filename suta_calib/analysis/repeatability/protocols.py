"""Two ways to visit a point compared: is one really better, and by how much at least?"""

from __future__ import annotations

from dataclasses import dataclass

from suta_calib.analysis.repeatability.intervals import Interval, difference, ratio
from suta_calib.analysis.repeatability.scatter import PositionScatter


@dataclass(frozen=True)
class Change:
    """One figure under two protocols.

    Attributes:
        first, second: its values, m.
        ratio: interval of second / first; one inside means that none was proved better.
        difference: interval of second - first, m.
    """

    first: float
    second: float
    ratio: Interval
    difference: Interval

    @property
    def proved(self) -> bool:
        """Whether the two differ by more than so few visits would by chance."""
        return 1.0 not in self.ratio


@dataclass(frozen=True)
class ProtocolComparison:
    """Two protocols, visits of each about their own barycentre.

    Attributes:
        first, second: their labels.
        rp: position repeatability, ISO 9283:1998, 7.2.2.
        rms: root mean square of the distances.
    """

    first: str
    second: str
    rp: Change
    rms: Change


def compare_protocols(
    first: str, one: PositionScatter, second: str, two: PositionScatter, confidence: float
) -> ProtocolComparison:
    """Compare two independent sets of visits."""
    changes = [
        Change(a.value, b.value, ratio(a, b, confidence), difference(a, b, confidence))
        for a, b in ((one.rp, two.rp), (one.rms, two.rms))
    ]
    return ProtocolComparison(first, second, *changes)
