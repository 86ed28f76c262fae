"""Do the residuals look like an eccentric encoder, a wrong gear ratio, or a joint that yields?

A score (Lagrange multiplier) test of each joint and each family of non-geometric parameters, at
the fit without them: nothing is fitted anew. With Z the columns of the family, X those of what else
is unknown, and ψ the robust residuals,

    S = Z̃ᵀψ,   Z̃ = Z - X (XᵀX)⁻¹ XᵀZ,   F = Sᵀ V⁻¹ S / k

where V sums the products of scores by touch, because rows that share a touch err together (Rao
1948, doi:10.1017/S0305004100023987; robust form: White 1982, doi:10.2307/1912526). Once X is what
the job frees, and once all of the geometry: a bent link must not be taken for an eccentric encoder.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.model.parameters import COUPLING, Family
from suta_calib.showing import Displayable
from suta_calib.solver.identifiability import WEAK
from suta_calib.solver.information import Rows
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.threads import single_threaded
from suta_calib.trust.examination import Examination
from suta_calib.trust.extended_problem import offered_names
from suta_calib.trust.scores import Scores, curvature_of, scores_of

# Chance by touches that what the variance alone says must have.
SUPPORTED: Final = 0.05


@dataclass(frozen=True)
class ScoreTest(Displayable):
    """One joint and one family of parameters.

    Attributes:
        joint: its name, or what all links have in common.
        family: one of `FAMILIES`.
        names: its parameters that the data could tell, one or two.
        estimate: what one step towards them would make of each, rad, rad/(N·m) or 1.
        p_single: chance of residuals so suspicious if the job's unknowns are all there is to know.
        p: the same, allowing for the number of tests (Bonferroni).
        p_beside_geometry: that if any of the geometry may be off too.
        p_variance: the same as ``p`` for so much of the residuals' variance explained, which tells
            more where touches are few and takes them to scatter alike, and to share as much of it
            as they do in the mean over all candidates (`Scores.shared`).
        beats_geometry: whether it explains more, for its few parameters, than the geometry that the
            job does not free would (Schwarz 1978, doi:10.1214/aos/1176344136).
        explains: how much that is, in units of what noise alone would explain: what looks alike by
            chance (a gain and a harmonic over a part of a turn) differs in it.
    """

    joint: str
    family: Family
    names: tuple[str, ...]
    estimate: tuple[float, ...]
    p_single: float
    p: float
    p_beside_geometry: float
    p_variance: float
    beats_geometry: bool
    explains: float

    @property
    def suspicious(self) -> bool:
        """Whether so much is neither chance nor geometry."""
        # Chance that one of all tests calls clean residuals suspicious.
        level = 0.01
        by_variance = self.p_variance < level and self.p_single < SUPPORTED
        by_chance = self.p < level or by_variance
        return self.p_beside_geometry < level or (by_chance and self.beats_geometry)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of a fit, to be tested for what the fit left out.

    Attributes:
        problem: the fit's unknowns, the rest of the geometry, and every candidate.
        rows: at the fit, with a column for each of these.
        fitted: names of what the fit had for its unknowns.
        free: how many of them the data have told (`effective_unknowns`).
        level: mean of (noise / assumed noise)² over the blocks.
    """

    problem: Problem
    rows: Sequence[Rows]
    fitted: frozenset[str]
    free: int
    level: float

    @classmethod
    def of(cls, answer: Examination, effective: float) -> Residuals:
        """Those of an answer over an arm, of which the data have told ``effective`` unknowns."""
        # Of a number of unknowns, that is none.
        fitted, free = (
            frozenset(answer.solution.problem.parameters),
            math.ceil(effective - 1e-6),
        )
        return cls(answer.problem, answer.rows, fitted, free, noise_ratio(answer.solution))

    @single_threaded
    def tests(self) -> tuple[ScoreTest, ...]:
        """Of every joint and family, most suspicious first; nothing with too few touches."""
        if not self.enough:
            return ()
        groups = self._groups
        alone, beside = self._alone, self._beside_geometry
        candidates = [
            (joint, family, np.array([self._order[n] for n in telling], dtype=np.intp))
            for (joint, family), names in groups.items()
            # Each coupling is a cause of its own; the two waves of a harmonic are one.
            for group in ([[n] for n in names] if family == COUPLING else [names])
            if (telling := [n for n in group if alone.telling[self._order[n]]])
        ]
        names, tests = list(self._order), []
        for joint, family, index in candidates:
            p = alone.p_by_touch(index, self._freedom)
            gain = self._gain(alone, index) - len(index) * float(np.log(alone.touches))
            p_variance = alone.p_variance(index, self._equations, self.free)
            tests.append(
                ScoreTest(
                    joint,
                    family,
                    tuple(names[i] for i in index),
                    tuple(float(v) for v in alone.step(index)),
                    p,
                    min(1.0, len(candidates) * p),
                    min(1.0, len(candidates) * beside.p_by_touch(index, self._freedom)),
                    min(1.0, len(candidates) * p_variance),
                    gain > self.by_geometry,
                    gain,
                )
            )
        return tuple(sorted(tests, key=lambda test: test.p_single))

    def chance(self, names: Iterable[str]) -> float:
        """Chance of so suspicious residuals as for these candidates together, without cause."""
        index = np.array([self._order[n] for n in names if n in self._order], dtype=np.intp)
        return self._alone.p_by_touch(index, self._freedom) if self.enough else 1.0

    def telling_names(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of the candidates that the data could tell."""
        return tuple(n for n in names if n in self._order and self._alone.telling[self._order[n]])

    @cached_property
    def _groups(self) -> dict[tuple[str, Family], tuple[str, ...]]:
        assert self.problem.arm is not None
        return {
            key: tuple(n for n in names if n not in self.fitted)
            for key, names in offered_names(self.problem.arm).items()
        }

    @cached_property
    def _order(self) -> dict[str, int]:
        """Number of each candidate among them all."""
        return {
            name: k for k, name in enumerate(n for names in self._groups.values() for n in names)
        }

    @cached_property
    def _columns(self) -> IntArray:
        return np.array([self.problem.names.index(n) for n in self._order], dtype=np.intp)

    @cached_property
    def _geometry(self) -> IntArray:
        """Columns of the geometry that was not fitted."""
        not_geometry = self._order.keys() | self.fitted
        return np.array(
            [k for k, n in enumerate(self.problem.names) if n not in not_geometry], dtype=np.intp
        )

    @cached_property
    def _alone(self) -> Scores:
        return self._scores(self._columns, self._geometry)

    @cached_property
    def _beside_geometry(self) -> Scores:
        return self._scores(self._columns, np.zeros(0, dtype=np.intp))

    def _scores(self, columns: IntArray, fixed: IntArray) -> Scores:
        return scores_of(self.problem, self.rows, columns, fixed, self._curvature)

    @cached_property
    def _curvature(self) -> FloatArray:
        return curvature_of(self.problem, self.rows)

    @single_threaded
    def geometry_is_held(self) -> bool:
        """Whether geometry that the job does not free explains the residuals, beyond any doubt.

        What is estimated makes up for it, and no ± knows.
        """
        # What geometry that is held explains beyond Schwarz's penalty that is very strong evidence
        # for it (Kass, Raftery 1995, doi:10.1080/01621459.1995.10476572).
        return self.enough and self.told_by_geometry(by_touch=True) > 10.0

    @property
    def enough(self) -> bool:
        """Whether there are touches beyond what the unknowns take."""
        return self._freedom > 0

    @property
    def _freedom(self) -> int:
        return self._alone.touches - self.free

    @property
    def _equations(self) -> int:
        return sum(t.equations() for t in self.problem.terms)

    def _gain(self, scores: Scores, chosen: IntArray) -> float:
        """How much one step lowers twice the cost, in units of what noise alone would.

        Rows that share touches repeat each other: what they count is what their touches do.
        """
        rows = sum(len(b) * b.size for t in self.problem.terms for b in t.blocks)
        lowered = float(scores.score[chosen] @ scores.step(chosen)) / self.level
        return lowered * self._equations / rows

    @cached_property
    def by_geometry(self) -> float:
        """What the geometry that is not freed would explain, less Schwarz's penalty."""
        return self.told_by_geometry()

    def told_by_geometry(self, *, by_touch: bool = False) -> float:
        """Likewise; ``by_touch`` where a touch counts as the pose that it is, at the most.

        Hundreds of corners of a picture share where the arm really was.
        """
        more = self._geometry
        if not len(more):
            return 0.0
        scores = self._scores(more, self._columns)
        plausible = self.problem.parameters.array("plausible")[more]
        values = np.linalg.eigvalsh(scores.curvature * np.outer(plausible, plausible))
        estimated = int(np.sum(values > WEAK**-2))
        gain = self._gain(scores, np.arange(len(more)))
        if by_touch:
            # Numbers that a pose is.
            pose = 6
            gain *= min(1.0, pose * scores.touches / max(self._equations, 1))
        return max(0.0, gain - estimated * float(np.log(scores.touches)))


def noise_ratio(solution: Solution) -> float:
    """Mean over the blocks of (noise / assumed noise)²."""
    pairs = zip(solution.noise, solution.sigmas, strict=True)
    return float(np.mean([(noise / sigma) ** 2 for noise, sigma in pairs]))
