"""Do the residuals look like an eccentric encoder, a wrong gear ratio, or a joint that yields?

Each joint and each family of non-geometric parameters is an effect beside the fit without them
(`evidence`). Two tests are made of it: by the squares that it explains, and by how much its scores
scatter from touch to touch, because rows that share a touch err together (White 1982,
doi:10.2307/1912526):

    F = Sᵀ V⁻¹ S / k,   S = Z̃ᵀψ

where Z̃ are its columns once all else has followed, ψ the robust residuals, and V sums the products
of scores by touch. Once what follows is what the job frees, and once all of the geometry: a bent
link must not be taken for an eccentric encoder.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import fdtrc

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.model.parameters import Family
from suta_calib.solver.identifiability import WEAK
from suta_calib.solver.information import scaled_inverse
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.threads import single_threaded
from suta_calib.trust.evidence import TELLING, Effect, weigh_effects
from suta_calib.trust.examination import Examination
from suta_calib.trust.extended_problem import causes, offered_beside
from suta_calib.trust.linear_fit import LinearFit


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
            more where touches are few and takes them to scatter alike (`Evidence.p_value`).
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
        by_chance = min(self.p, self.p_variance) < level
        return self.p_beside_geometry < level or (by_chance and self.beats_geometry)


@dataclass(frozen=True, eq=False)
class _Scores:
    """Of all candidates beside a fit.

    Attributes:
        score: (k,) S.
        variance: (k, k) V.
    """

    score: FloatArray
    variance: FloatArray

    @classmethod
    def of(cls, fit: LinearFit, columns: FloatArray) -> _Scores:
        left = fit.followed(columns)
        score = fit.scores(left, fit.settled).sum(axis=0)
        return cls(score, fit.score_variance(left, fit.settled))

    def p_by_touch(self, chosen: IntArray, freedom: int) -> float:
        """Chance of so large scores of some candidates together."""
        if not len(chosen):
            return 1.0
        variance = self.variance[np.ix_(chosen, chosen)]
        pushed = np.linalg.pinv(variance, hermitian=True) @ self.score[chosen]
        return float(fdtrc(len(chosen), freedom, self.score[chosen] @ pushed / len(chosen)))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of a fit, to be tested for what the fit left out.

    Attributes:
        problem: the fit's unknowns, the rest of the geometry, and every candidate.
        fit: with a column for each of these.
        fitted: names of what the fit had for its unknowns.
        free: how many of them the data have told (`effective_unknowns`).
        level: mean of (noise / assumed noise)² over the blocks.
    """

    problem: Problem
    fit: LinearFit
    fitted: frozenset[str]
    free: int
    level: float

    @classmethod
    def of(cls, answer: Examination, effective: float) -> Residuals:
        """Those of an answer over an arm, of which the data have told ``effective`` unknowns."""
        # Of a number of unknowns, that is none.
        free = math.ceil(effective - 1e-6)
        fitted = frozenset(answer.solution.problem.parameters)
        # What priors pull at was settled when the answer was fitted.
        fit, level = replace(answer.everything, from_prior=None), noise_ratio(answer.solution)
        return cls(answer.problem, fit, fitted, free, level)

    @single_threaded
    def tests(self) -> tuple[ScoreTest, ...]:
        """Of every joint and family, most suspicious first; nothing with too few touches."""
        if not self.enough:
            return ()
        effects = [
            Effect(f"{joint} {family}", self._columns[:, at], about=(joint, family, tuple(telling)))
            for (joint, family), names in self._groups.items()
            for group in causes(family, names)
            if (telling := self.telling_names(group))
            for at in [self._places(telling)]
        ]
        tests = []
        for evidence in weigh_effects(self._alone, effects):
            joint, family, names = evidence.effect.about
            at = self._places(names)
            p, beside = (
                scores.p_by_touch(at, self._freedom)
                for scores in (self._scores, self._scores_beside_geometry)
            )
            gain = self._gain(evidence.gain) - len(at) * math.log(self._touches)
            tests.append(
                ScoreTest(
                    joint,
                    family,
                    names,
                    tuple(evidence.size.tolist()),
                    p,
                    min(1.0, len(effects) * p),
                    min(1.0, len(effects) * beside),
                    evidence.p_value,
                    gain > self.by_geometry,
                    gain,
                )
            )
        return tuple(sorted(tests, key=lambda test: test.p_single))

    def chance(self, names: Iterable[str]) -> float:
        """Chance of so suspicious residuals as for these candidates together, without cause."""
        at = self._places(self.telling_names(names))
        return self._scores.p_by_touch(at, self._freedom) if self.enough else 1.0

    def telling_names(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of the candidates that the data could tell."""
        return tuple(n for n in names if n in self._order and self._telling[self._order[n]])

    def _places(self, names: Sequence[str]) -> IntArray:
        return np.array([self._order[name] for name in names], dtype=np.intp)

    @cached_property
    def _groups(self) -> dict[tuple[str, Family], tuple[str, ...]]:
        assert self.problem.arm is not None
        return {
            key: tuple(n for n in names if n not in self.fitted)
            for key, names in offered_beside(self.problem).items()
        }

    @cached_property
    def _order(self) -> dict[str, int]:
        """Number of each candidate among them all."""
        names = (name for group in self._groups.values() for name in group)
        return {name: k for k, name in enumerate(names)}

    def _numbers(self, names: Iterable[str]) -> IntArray:
        chosen = {*names}
        return np.flatnonzero([name in chosen for name in self.problem.names])

    @cached_property
    def _columns(self) -> FloatArray:
        """(m, k) of all candidates, in their order."""
        at = [self.problem.names.index(name) for name in self._order]
        return self.fit.jacobian[:, at]

    @cached_property
    def _alone(self) -> LinearFit:
        """Only what was fitted follows."""
        return self.fit.only(self._numbers(self.fitted))

    @cached_property
    def _telling(self) -> list[bool]:
        """Whether the data would tell each candidate well enough."""
        curvature = np.diag(self._alone.curvature(self._columns))
        plausible = np.array([self.problem.parameters[n].plausible for n in self._order])
        return [bool(told_well) for told_well in curvature * (TELLING * plausible) ** 2 > 1.0]

    @cached_property
    def _scores(self) -> _Scores:
        return _Scores.of(self._alone, self._columns)

    @cached_property
    def _scores_beside_geometry(self) -> _Scores:
        names = self._order.keys()
        beside = self.fit.only(self._numbers(n for n in self.problem.names if n not in names))
        return _Scores.of(beside, self._columns)

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
    def _touches(self) -> int:
        return self.fit.cluster_count

    @property
    def _freedom(self) -> int:
        return self._touches - self.free

    def _gain(self, squares: float) -> float:
        """Squares that are explained, in units of what noise alone would explain.

        Rows that share touches repeat each other: what they count is what their touches do.
        """
        return squares / self.level * self.fit.rows / len(self.fit.residual)

    @cached_property
    def by_geometry(self) -> float:
        """What the geometry that is not freed would explain, less Schwarz's penalty."""
        return self.told_by_geometry()

    def told_by_geometry(self, *, by_touch: bool = False) -> float:
        """Likewise; ``by_touch`` where a touch counts as the pose that it is, at the most.

        Hundreds of corners of a picture share where the arm really was.
        """
        names = {*self._order, *self.fitted}
        more = self._numbers(n for n in self.problem.names if n not in names)
        if not len(more):
            return 0.0
        plausible = self.problem.parameters.array("plausible")[more]
        columns = self.fit.jacobian[:, more] * plausible
        curvature = self._alone.curvature(columns)
        score = self._alone.scores(columns, self._alone.settled).sum(axis=0)
        estimated = int(np.sum(np.linalg.eigvalsh(curvature) > WEAK**-2))
        # It follows as far as is known beforehand.
        inverse = scaled_inverse(curvature + np.diag(self.fit.prior[more] * plausible**2))
        gain = self._gain(float(score @ inverse @ score))
        if by_touch:
            # Numbers that a pose is.
            pose = 6
            gain *= min(1.0, pose * self._touches / max(self.fit.rows, 1))
        return max(0.0, gain - estimated * math.log(self._touches))


def noise_ratio(solution: Solution) -> float:
    """Mean over the blocks of (noise / assumed noise)²."""
    pairs = zip(solution.noise, solution.sigmas, strict=True)
    return float(np.mean([(noise / sigma) ** 2 for noise, sigma in pairs]))
