"""Poses that were found with the file of another camera: everything is nearer or farther.

Who finds poses with the focal length of another camera finds directions nearly right, and every
distance along the axis too long by one factor. A nominal arm is too coarse to tell the factor: it
is found by steps of Gauss and Newton from the fit, each with a fit anew.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from suta_calib.errors import SutaCalibError
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import Term
from suta_calib.trust import Effect, Examination, Reinterpretation, SpoiltData, Truth, weigh_effects
from suta_calib.trust.examination import STEP
from suta_calib.trust.rereading import QUICK_FIT
from suta_calib.trust.simulated_faults import by_chain, with_columns

# Factors, less one, that are no rounding and still another camera's.
LEAST, MOST = 5e-3, 0.7


class OtherCamera(Reinterpretation):
    """``z → z f`` for every pose that was seen, with one factor f for all of them."""

    name = "other camera"
    about = "Poses were computed with the file of another camera."
    precedence = 81
    tried = "fitted"

    def readings(self, data: Problem) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """One, where poses were seen and the factor is not one; of several chains one for each."""
        for where, suspects in by_chain(data.terms):
            for description, terms in self._of(data, suspects):
                yield description + where, terms

    def _of(
        self, data: Problem, suspects: Sequence[Term]
    ) -> Iterator[tuple[str, tuple[Term, ...]]]:
        """That of some of the terms."""
        # Steps, and from which on the next is none worth taking.
        steps = 4
        settled = 1e-4
        seen = [term in suspects and _seen_as_poses(term) for term in data.terms]
        if not any(seen):
            return
        with suppress(SutaCalibError):
            terms, factor = tuple(data.terms), 1.0
            for _ in range(steps):
                too_long = _step(Problem(terms, data.arm_parameters), seen)
                factor /= 1.0 + max(too_long, LEAST - 1.0)
                if abs(factor - 1.0) > MOST:
                    return
                terms = _all_at_depth(data.terms, seen, factor)
                if abs(too_long) < settled:
                    break
            by = 1.0 / factor - 1.0
            if abs(by) > LEAST:
                yield _description(by), terms

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Everything 8 % too far."""
        return SpoiltData(_at_depth(data, 1.08), effect=_description(0.08)[:18])


def _description(by: float) -> str:
    return (
        f"targets are {100 * abs(by):.2f} % too {'far' if by > 0 else 'near'} along "
        "the z axis of the camera, as with another camera's file"
    )


def _step(problem: Problem, seen: Sequence[bool]) -> float:
    """By what ratio depths of some terms are too long at the fit of a problem, to first order."""
    answer = Examination.of_poses(solve(problem, QUICK_FIT))
    longer = _all_at_depth(problem.terms, seen, 1.0 + STEP)
    evidence = weigh_effects(answer.fit, [Effect("depth", answer.by_terms(longer))])
    return -float(evidence[0].size[0]) if evidence else 0.0


def _seen_as_poses(term: Term) -> bool:
    samples = term.poses.samples
    return samples.position is not None and samples.rotation is not None


def _all_at_depth(terms: Sequence[Term], seen: Sequence[bool], factor: float) -> tuple[Term, ...]:
    pairs = zip(terms, seen, strict=True)
    return tuple(_at_depth(term, factor) if far else term for term, far in pairs)


def _at_depth(term: Term, factor: float) -> Term:
    samples = term.poses.samples
    if not _seen_as_poses(term) or samples.position is None:
        return term
    return with_columns(term, position=samples.position * [1.0, 1.0, factor])
