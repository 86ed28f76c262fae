"""An instrument whose clock differs from that of the readings, where the samples have times."""

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from suta_calib.errors import SutaCalibError, SutaCalibWarning
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import solve
from suta_calib.terms import Term
from suta_calib.terms.clock import TimeOffset
from suta_calib.trust import Effect, Evidence, Examination, Hypothesis, SpoiltData, Truth
from suta_calib.trust.hypotheses.measured_in_motion import LateRows, Moving, in_motion, said_late
from suta_calib.trust.simulated_faults import with_columns


class LateClock(Hypothesis):
    """Every observation is late by the same time: the job is solved again with it as an unknown.

    A fit that lacks it may be so far off that its residuals, linear about it, do not show the
    arm's motion: of three simulated cameras on an arm that were 20 ms late, two.
    """

    name = "late clock"
    about = "The clock of an instrument that sees a moving arm differs from that of its readings."
    before_others = True
    by_itself = True
    worth = LateRows.worth

    def applies(self, problem: Problem) -> bool:
        """Whether a term with times has no time offset."""
        timed = any(t.poses.samples.time is not None and not t.of_clock for t in problem.terms)
        return timed and super().applies(problem)

    def weigh(self, answer: Examination) -> list[Evidence]:
        """One for each term whose arm moved smoothly, each solved again alone."""
        fitted = [
            self._late(answer, k, moving)
            for k, moving, _ in in_motion(answer)
            if moving.step is not None
        ]
        return [evidence for evidence in fitted if evidence is not None]

    def _late(self, answer: Examination, k: int, moving: Moving) -> Evidence | None:
        """The time offset of a term, with what it explains; None where it cannot be estimated."""
        given = answer.solution.problem
        terms, mine = [*given.terms], given.terms[k]
        for n, term in enumerate(given.terms):
            same_clock = (term.kind, term.sees) == (mine.kind, mine.sees)
            if same_clock and term.poses.samples.time is not None:
                terms[n] = replace(term, time_offset=TimeOffset())
        options = SolverOptions(starts=1, confirm=False)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SutaCalibWarning)
                again = solve(Problem(terms, given.arm_parameters), options)
        except SutaCalibError:  # Too few rows beside each other, or for one unknown more.
            return None
        clock = again.problem.terms[k].of_clock[:1]
        late = again.estimates[clock[0].name] if clock and again.converged else None
        if late is None or not late.std:
            return None
        before, after = (_level(s, answer.solution, k) for s in (answer.solution, again))
        share, step = max(1.0 - after / before, 0.0), moving.step or 1.0
        fit = answer.fit
        gain, noise = share * fit.squares, (1.0 - share) * fit.squares / fit.rows
        size, std = late.value / step, late.std / step
        chance = 2.0 * float(ndtr(-abs(size) / std))
        effect = Effect(f"term {k + 1}", np.zeros((len(fit.jacobian), 1)), about=moving)
        return Evidence(
            effect,
            window=None,
            size=np.array([size]),
            covariance=np.array([[std**2]]),
            gain=gain,
            share=share,
            rank=1,
            noise=max(noise, math.ulp(0.0)),
            design=1.0,
            p_single=chance,
            p_value=chance,
            moves=np.zeros(fit.jacobian.shape[1]),
        )

    def sentence(self, evidence: Evidence) -> str:
        """By how much it is late, what that is at the tip, and what to do."""
        return said_late(evidence)

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """As rows that are late, with times."""
        spoilt = LateRows().spoil(data, values, rng)
        time = 0.1 * np.arange(len(spoilt.data.poses))
        return replace(spoilt, data=with_columns(spoilt.data, time=time))


def _level(solution: Solution, like: Solution, k: int) -> float:
    """Mean square of a term's whitened residuals, as far as a robust fit believes them."""
    term: Term = solution.problem.terms[k]
    lines = solution.problem.linearise(solution.x, like.sigmas)
    mine = [line for line in lines if any(line.view.block is block for block in term.blocks)]
    squares = sum(
        float(np.sum(line.weight[:, None] * (line.residual / line.sigma[:, None]) ** 2))
        for line in mine
    )
    return max(squares / sum(line.residual.size for line in mine), math.ulp(0.0))
