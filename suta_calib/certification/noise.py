"""What a touch is worth: on the planes, and on features that its own touches show to be worse.

The tops' and the ground's planes tell the noise of a touch. On holes and on the side a touch may be
worth less: another nest, a worn edge, a probe that slides. How far the middles of a pillar's
diagonals lie apart tells it, and how far the side's touches lie from their plane. Holes that are
drilled unevenly look the same; the data do not tell one from the other, and the larger is believed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from scipy.special import chdtri, fdtri

from suta_calib.arrays import FloatArray
from suta_calib.certification.measuring import UNEVEN, MeasuredArtefact
from suta_calib.certification.points import RawPoints
from suta_calib.certification.scatter import FINEST, Scatter
from suta_calib.errors import SamplesError

Kind = Literal["hole", "side"]
# Freedom from which on the touches' own scatter says what a touch is worth.
ENOUGH_FREEDOM: Final = 4


@dataclass(frozen=True)
class ProbingNoise:
    """What a touch is worth."""

    # Standard deviation of a coordinate on tops and flats, m; on holes and side too, unless these
    # have one of their `by_kind`.
    touch: float
    ground: float  # of one on the ground, which may be rougher, m
    freedom: float  # degrees of freedom of these; inf where they are stated
    # Of features whose touches scatter more than those of the planes, beyond chance.
    by_kind: Mapping[Kind, Scatter] = field(default_factory=dict)

    def of(self, kind: Kind) -> float:
        """Standard deviation of a coordinate touched on such a feature, m."""
        return self.by_kind[kind].sigma if kind in self.by_kind else self.touch

    def freedom_of(self, *kinds: Kind) -> float:
        """The fewest degrees of freedom of what planes and these features tell."""
        return min(
            [self.freedom, *(float(self.by_kind[k].freedom) for k in kinds if k in self.by_kind)]
        )

    def beside(self, kind: Kind, scatter: Scatter) -> ProbingNoise:
        """The same, with what such a feature's touches scatter where that is more beyond chance."""
        # Chance that holes or side as good as the tops get a noise of their own: no word is said of
        # it, and were it smaller, touches half as bad again would not be told.
        worse = scatter.exceeds(self.touch, self.freedom, 0.05)
        if scatter.freedom < ENOUGH_FREEDOM or not worse:
            return self
        return replace(self, by_kind={**self.by_kind, kind: scatter})


def scatter_of_holes(uneven: FloatArray) -> Scatter:
    """What touches of holes scatter, from the middles of each pillar's two diagonals.

    ``uneven`` are these apart, (n, 2), m: half of the sum of two touches less that of the two
    others, which scatters as one touch does. The median pillar says what is usual; it is worth
    half of the pillars. One that lies far beyond is damaged, or its probe slipped, and does not
    count.
    """
    count = len(uneven)
    # Fewer pillars do not say what a touch of a hole is worth: one may be damaged.
    if count < 5:
        return Scatter(0.0, 0)
    squared = np.sum(uneven**2, axis=1)
    usual = float(np.median(squared)) / chdtri(2, 0.5)
    # Chance that any pillar is kept out of that wrongly.
    kept_out = 0.001
    inliers = squared <= 2.0 * max(usual, FINEST**2) * fdtri(2, count, 1.0 - kept_out / count)
    return Scatter(float(squared[inliers].sum()), 2 * int(inliers.sum()))


def noise_of(measured: MeasuredArtefact, stated: float | None, raw: RawPoints) -> ProbingNoise:
    """The stated noise where residuals bear it out, else theirs; on holes no less than theirs."""
    uneven = np.array([g.values[UNEVEN] for g in measured.geometry])
    return _noise_of_planes(measured, stated, raw).beside("hole", scatter_of_holes(uneven))


def _noise_of_planes(
    measured: MeasuredArtefact, stated: float | None, raw: RawPoints
) -> ProbingNoise:
    # Chance that a stated noise, or a ground as smooth as the tops, is doubted wrongly.
    doubt = 0.001
    tops = sum((top.scatter for top in measured.tops if top.even), Scatter(0.0, 0))
    ground = measured.ground.scatter
    if stated is not None:
        touch, freedom = stated, np.inf
        if tops.exceeds(stated, np.inf, doubt):
            touch, freedom = max(tops.sigma, FINEST), float(tops.freedom)
        rough = ground.exceeds(touch, np.inf, doubt)
        return ProbingNoise(touch, max(ground.sigma, touch) if rough else touch, freedom)
    if (freedom := (tops + ground).freedom) < ENOUGH_FREEDOM:
        raise SamplesError(
            f"only {freedom} more touches than the planes need, too few to estimate the noise of "
            "a touch",
            "five touches on each top, or the noise of a touch as a number",
            file=raw.path,
            hint="give it with --sigma-um",
        )
    # A ground rougher than the tops is no worse an instrument.
    same = not tops.freedom or not ground.exceeds(tops.sigma, tops.freedom, doubt)
    learnt = tops + ground if same else tops
    touch = max(learnt.sigma, FINEST)
    return ProbingNoise(touch, touch if same else ground.sigma, float(learnt.freedom))
