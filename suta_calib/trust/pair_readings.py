"""Which other reading of pairs of poses makes them agree: the mechanism behind `MisreadPairs`.

The angle by which hand and eye turn between two pairs is the same whatever X is, but it shows none
of these faults: a pose and its inverse turn by the same angle, and so do quaternions whose numbers
are exchanged in the same way everywhere. Whether an X closes all loops ``A X B`` shows them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.terms.hand_eye import HandEye
from suta_calib.terms.hand_eye_start import Poses, some_poses
from suta_calib.terms.poses import MeasuredPoses
from suta_calib.trust.hypothesis import Reinterpretation, SpoiltData, known_hypotheses
from suta_calib.trust.rule import Rule
from suta_calib.units import from_deg

# Pairs that are enough to tell one reading from another.
MOST_PAIRS: Final = 200


@dataclass(frozen=True, eq=False)
class Pairs:
    """Poses of a hand and of the target in its eye, pair by pair.

    Attributes:
        hand: ``T_base_hand``, rotations (n, 3, 3) and positions (n, 3).
        seen: ``T_eye_target``, the same.
        unit: of their lengths, in the unit that they were given in.
    """

    hand: Poses
    seen: Poses
    unit: float = 1.0

    def rows(self, hand: IntArray, seen: IntArray) -> Pairs:
        """Some poses of the hand, each with the target of another row."""
        return replace(self, hand=some_poses(self.hand, hand), seen=some_poses(self.seen, seen))

    @property
    def few(self) -> Pairs:
        """`MOST_PAIRS` of them at most, evenly."""
        count = len(self.hand[1])
        rows = np.unique(np.linspace(0, count - 1, MOST_PAIRS).astype(np.intp))
        return self.rows(rows, rows)


# What would have to be so, as "if …" (in braces the other setup), and the pairs then.
Reading = tuple[str, Pairs]


class MisreadPairs(Reinterpretation):
    """Pairs of poses that are read differently."""

    applies_to: ClassVar[tuple[type[HandEye], ...]] = (HandEye,)
    needs_arm: ClassVar[bool] = False

    @abstractmethod
    def readings(self, data: Any) -> Iterator[Reading]:
        """All ways to read `Pairs`."""

    @abstractmethod
    def fault(self, pairs: Pairs) -> Pairs:
        """The pairs as somebody gets them wrong."""

    def sentence(self, evidence: Any) -> str:
        """What would have to be so."""
        return f"The pairs agree far better {evidence}."

    def spoil(self, data: Any, values: Mapping[str, float], rng: np.random.Generator) -> SpoiltData:
        """All pairs with the `fault`."""
        del values, rng
        term: HandEye = data
        samples = term.poses.samples
        assert samples.position is not None
        assert samples.rotation is not None
        pairs = self.fault(Pairs(term.poses.at({}), (samples.rotation, samples.position)))
        seen = replace(samples, rotation=pairs.seen[0], position=pairs.seen[1])
        return SpoiltData(term.over_poses(MeasuredPoses(*pairs.hand, seen)), np.zeros(0))


@dataclass(frozen=True)
class AgreeingReading:
    """A reading of pairs under which they agree.

    Attributes:
        hypothesis: that yielded it.
        description: what would have to be so, as "if …".
        scatter: of the loops then, about every axis: in the given unit of length, and rad.
    """

    hypothesis: MisreadPairs
    description: str
    scatter: tuple[float, float]


def agreeing_reading(
    pairs: Pairs, scatter: float, spread: Callable[[Pairs], FloatArray], rule: Rule = Rule()
) -> AgreeingReading | None:
    """The reading under which the loops close best; None where it is not far better.

    Args:
        pairs: as they were given.
        scatter: of their loops, in their unit of length.
        spread: scatter (2,) of the loops of pairs, in their unit of length and rad.
        rule: how much better is far better.
    """
    best, description, cause, unit = np.array([np.inf, np.inf]), "", None, 1.0
    for hypothesis in known_hypotheses().values():
        if not isinstance(hypothesis, MisreadPairs):
            continue
        for reading, read in hypothesis.readings(pairs):
            found = spread(read.few)
            if found[0] < best[0]:
                best, description, cause, unit = found, reading, hypothesis, read.unit
    # Times by which the scatter of the loops is less, where `Rule.far_better` asks for less: chance
    # halves it among so many readings of eight pairs, and never divides it by five.
    far_better = max(5.0, rule.far_better)
    # Loops of a reading turn no worse than this against one another, rad.
    turns_agree = from_deg(5.0)
    if cause is None or far_better * best[0] >= scatter or best[1] >= turns_agree:
        return None
    return AgreeingReading(cause, description, (float(unit * best[0]), float(best[1])))
