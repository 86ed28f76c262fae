"""A least-squares problem: terms that share parameters.

    minimise over x   ½ Σ_rows ρ(‖r(x)‖² / σ²)  +  ½ Σ ((x - nominal) / prior)²

with Huber's ρ per block and x within its bounds. `Problem` is data: `solve` minimises it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.errors import ParameterError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.model.robot import Robot, joined
from suta_calib.solver.evaluation import BlockView, Evaluation, Linearised
from suta_calib.terms.block import Block, grouped_rows
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.several_chains import over_one_mechanism
from suta_calib.terms.term import Term
from suta_calib.units import Unit

# Noise of one component where a job does not say: half a millimetre, as optical trackers and seated
# plugs scatter, and a tenth of a degree; of other numbers a thousandth, as of the components of a
# direction. It only matters against priors and between kinds.
DEFAULT_SIGMA: Final[dict[Unit, float]] = {"m": 0.5e-3, "rad": math.radians(0.1)}
PLAIN_SIGMA: Final = 1e-3


# Samples of a term of which what is true on average of all is asked, where there are twice as many:
# what is summed over them is then known to a hundredth.
ENOUGH: Final = 10_000


def assumed_sigma(block: Block) -> float:
    """Noise level of a block of which no job says it, m, rad or as its numbers are."""
    return block.assumed or DEFAULT_SIGMA.get(block.unit, PLAIN_SIGMA)


@dataclass(frozen=True, eq=False)
class Part:
    """A problem over some of another's samples.

    Attributes:
        problem: over the same parameters.
        rows: of each block of the other which it has, (k,); None for all.
    """

    problem: Problem
    rows: tuple[IntArray | None, ...]


class Problem:
    """Terms, the arm's unknowns and the terms' own, as one vector.

    Args:
        terms: observations, of any kinds.
        parameters: the arm's parameters that are to be estimated (`ArmModel.select`); leave it
            out when no term looks at an arm.

    Attributes:
        parameters: the arm's, then the terms' own.
        arm_parameters: the arm's alone.
        arm: the arm that all terms share; the robot whose chains they are over; or None.
        arm_count: how many of the parameters are the arm's.

    Raises:
        ParameterError: no term, terms over arms that are no chains of one robot, or one name for
            different unknowns.
    """

    def __init__(self, terms: Sequence[Term], parameters: ParameterSet | None = None) -> None:
        self.terms = tuple(terms)
        for term in self.terms:
            if not isinstance(term, Term):
                raise ParameterError(repr(term), "a term", where="Problem")
        if not isinstance(parameters, ParameterSet | None):
            hint = "arm.select gives them"
            raise ParameterError(repr(parameters), "parameters", where="Problem", hint=hint)
        if not self.terms:
            raise ParameterError("no observations", "at least one term")
        self.terms = over_one_mechanism(self.terms)
        arms = tuple(t.poses.arm for t in self.terms if isinstance(t.poses, ArmPoses))
        self.arm: ArmModel | Robot | None = joined(arms) if arms else None
        chosen = ParameterSet() if parameters is None else parameters
        own_parameters = _own_parameters(self.terms)
        self.parameters = (
            ParameterSet([*chosen.values(), *own_parameters.values()]) if own_parameters else chosen
        )
        self.arm_parameters, self.arm_count = chosen, len(chosen)
        self._own_index = {name: k for k, name in enumerate(own_parameters)}
        self._prior_scale = np.ones(len(self.parameters))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Blocks of all terms, in order."""
        return tuple(block for term in self.terms for block in term.blocks)

    @cached_property
    def evaluation(self) -> Evaluation:
        """Cost and derivatives; built once, used by every start and every study."""
        views, first, clocks = [], 0, list[int | None]()
        for number, term in enumerate(self.terms):
            columns = np.array(
                [self._own_index[p.name] for p in term.own_parameters], dtype=np.intp
            )
            clock = [self._own_index[p.name] for p in term.of_clock]
            views += [
                BlockView(
                    *(block, first, _columns_of(block, columns, clock), len(clock)),
                    late=None if block.lag is None else term.poses_of(block),
                    source=number,
                )
                for block in term.blocks
            ]
            clocks.append(self.arm_count + clock[0] if clock else None)
            first += len(term.poses)
        names = self.names[: self.arm_count]
        sources = [term.poses for term in self.terms]
        return Evaluation(sources, views, names, len(self._own_index), clocks)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of a parameter vector."""
        return self.parameters.names

    def start(self, arm_values: Mapping[str, float] | None = None) -> FloatArray:
        """The vector for given arm values (nominal where not given) and closed-form own ones."""
        values = {p.name: p.nominal for p in self.arm_parameters.values()}
        values |= {k: v for k, v in (arm_values or {}).items() if k in values}
        for term in self.terms:
            for name, value in term.start_values(values).items():
                values.setdefault(name, value)
        # What is given of the own ones is where they begin.
        values |= {
            p.name: p.nominal
            for p in list(self.parameters.values())[self.arm_count :]
            if p.prior is not None or not p.free
        }
        return np.array([values[name] for name in self.names])

    def values(self, x: FloatArray) -> dict[str, float]:
        """A vector as parameter values by name."""
        return {name: float(v) for name, v in zip(self.names, x, strict=True)}

    def assumed_sigmas(self) -> list[float]:
        """Noise level of each block as the job gives it, or `assumed_sigma`."""
        return [b.noise.sigma or assumed_sigma(b) for b in self.blocks]

    def prior_precision(self) -> FloatArray:
        """1/prior² per parameter (n,), zero where nothing is known beforehand."""
        prior = self.parameters.array("prior") * self._prior_scale
        return np.where(np.isnan(prior), 0.0, prior**-2.0)

    def stated_precision(self) -> FloatArray:
        """1/prior² per parameter (n,) of what may be said to be known before any data.

        A factor below one that was learned of a group makes better estimates, but data that find
        other members of the group right are silent on one that they cannot tell: of that one no
        more is known than the job says.
        """
        return self.with_priors_scaled(np.maximum(self._prior_scale, 1.0)).prior_precision()

    def with_priors_scaled(self, scale: FloatArray) -> Problem:
        """The same problem with priors that are wider by a factor per parameter (n,)."""
        other = copy(self)
        other.evaluation, other._prior_scale = self.evaluation, scale
        return other

    def with_thresholds(self, limits: Sequence[float]) -> Problem:
        """The same problem with Huber thresholds of at most so much, m or rad, for each block."""
        other = copy(self)
        other.evaluation = self.evaluation.limited(limits)
        return other

    def as_given(self) -> Problem:
        """The same problem with the priors of the job, without learned factors."""
        return self.with_priors_scaled(np.ones(len(self.parameters)))

    @cached_property
    def postures(self) -> tuple[tuple[IntArray, IntArray], ...]:
        """For each block the number of the posture (rows,) of each row, and how many are at each.

        A row that looks at several samples is at the postures of all of them, in any order.
        """
        first = self.evaluation.table.first
        groups = [k + term.poses.postures for k, term in zip(first, self.terms, strict=False)]
        posture = np.concatenate(groups)
        return tuple(
            grouped_rows(posture[view.block.samples + view.first_sample])
            for view in self.evaluation.views
        )

    @cached_property
    def part(self) -> Part | None:
        """A random part of each term that has very many samples, a row for each; None of few.

        None as well where the part would have other unknowns, or the same in another order.
        """
        terms, rows = list[Term](), list[IntArray | None]()
        for k, term in enumerate(self.terms):
            n, chosen = len(term.poses), None
            one_row = np.arange(n)[:, None]
            if n > 2 * ENOUGH and all(np.array_equal(b.samples, one_row) for b in term.blocks):
                random = np.random.default_rng(k)
                chosen = np.sort(random.choice(n, ENOUGH, replace=False)).astype(np.intp)
            terms.append(term if chosen is None else term.take(chosen))
            rows += [chosen] * len(term.blocks)
        if all(chosen is None for chosen in rows):
            return None
        part = Problem(terms, self.arm_parameters)
        return Part(part, tuple(rows)) if part.names == self.names else None

    def linearise(self, x: FloatArray, sigmas: Sequence[float]) -> list[Linearised]:
        """Residuals and derivatives of every block at x, for given noise levels."""
        return self.evaluation.linearise(x, sigmas)


def _columns_of(block: Block, columns: IntArray, clock: Sequence[int]) -> IntArray:
    """(n, m) which of a problem's own parameters the rows look at: the term's, then its clock."""
    of_term = columns[block.own_columns] if block.own_columns.shape[1] else block.own_columns
    return np.hstack([of_term, np.tile(np.array(clock, dtype=np.intp), (len(of_term), 1))])


def _own_parameters(terms: Sequence[Term]) -> dict[str, Parameter]:
    """Own unknowns of all terms; a name that occurs twice is one unknown of the same thing.

    What one term is given of it holds for all of them.
    """
    parameters: dict[str, Parameter] = {}
    subjects: dict[str, str] = {}
    for term in terms:
        for parameter in term.unknowns:
            subject = subjects.setdefault(parameter.name, term.subject)
            if subject != term.subject:
                raise ParameterError(
                    f"{parameter.name} of {subject} and of {term.subject}",
                    "one name for one thing",
                    hint=(
                        "give the row of one of the two another label: a label stands for one clock"
                        if parameter in term.of_clock
                        else "give the placements of one of the two other labels"
                    ),
                )
            before = parameters.get(parameter.name, parameter)
            given = [p for p in (before, parameter) if p.prior is not None or not p.free]
            if len(given) == 2 and given[0] != given[1]:
                raise ParameterError(
                    f"two given poses that differ in {parameter.name}",
                    "one pose per place",
                    hint="give it in one row of the observations",
                )
            parameters[parameter.name] = given[0] if given else parameter
    return parameters
