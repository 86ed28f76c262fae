"""The interface of a solver, and the check of its results."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SolverError, SutaCalibError
from suta_calib.solver.nlp import RobustNlp

# Statuses of Gauss-Newton steps that come to a minimum, or to one that an earlier start has found.
SETTLED: Final = "Gauss_Newton_Settled"
JOINED: Final = "Joined_Earlier_Start"


@dataclass(frozen=True, eq=False)
class Answer(Displayable):
    """Where a solver ended.

    Attributes:
        z: (k,) the scaled variables.
        converged: whether the solver says that it is a minimum.
        status: the solver's own word.
        iterations: how many it took.
        solver: who stopped there; the name of the solver that was asked by default.
        cost: at z; it is computed where a solver does not check itself.
    """

    z: FloatArray
    converged: bool
    status: str = ""
    iterations: int = 0
    solver: str = ""
    cost: float = math.nan


@dataclass(frozen=True, eq=False)
class Minimum(Displayable):
    """Where a start ended.

    Attributes:
        x: (n,) the whole parameter vector, fixed entries included.
        cost: robust cost with priors.
        status: the solver's own word.
        iterations: how many it took, of all methods.
        converged: whether it is a minimum.
        solver: who stopped there.
    """

    x: FloatArray
    cost: float
    status: str
    iterations: int
    converged: bool
    solver: str

    @property
    def joined(self) -> bool:
        """Whether it came to an earlier start's minimum, and was not carried on."""
        return self.status == JOINED


class Solver(ABC):
    """Minimises a `RobustNlp` from one start. Subclasses are final.

    Attributes:
        name: as the report calls it.
        checks_itself: whether every answer is finite, within bounds and no higher than its start.
    """

    name: ClassVar[str]
    checks_itself: ClassVar[bool] = False

    @abstractmethod
    def search(self, nlp: RobustNlp, z: FloatArray) -> Answer:
        """Go down from z (k,), which is within ``nlp.lower`` and ``nlp.upper``.

        ``nlp`` offers `RobustNlp.cost`, `RobustNlp.cost_gradient_hessian`, and, for solvers of
        least squares, `RobustNlp.residuals` and `RobustNlp.jacobian`.
        """

    def nearby(self, nlp: RobustNlp, start: FloatArray) -> Minimum | None:
        """The minimum beside a start (n,) that is nearly one; None where it is not found."""
        minimum = self.minimise(nlp, start)
        return minimum if minimum.converged else None

    def confirmed(self, nlp: RobustNlp, minimum: Minimum) -> Minimum:
        """The lowest minimum, checked once more; unchanged by default."""
        del nlp
        return minimum

    def minimise(self, nlp: RobustNlp, start: FloatArray) -> Minimum:
        """The end of one start (n,), checked.

        Raises:
            SolverError: the search raises, or answers something that cannot be used.
        """
        z = nlp.begin(start)
        if not len(z):
            return Minimum(start, nlp.cost(z), SETTLED, 0, True, self.name)  # Nothing is free.
        answer = self.search(nlp, z) if self.checks_itself else self._checked(nlp, z)
        return Minimum(
            nlp.unscaled(answer.z),
            answer.cost,
            answer.status,
            answer.iterations,
            answer.converged,
            answer.solver or self.name,
        )

    def minimise_all(
        self,
        nlp: RobustNlp,
        starts: Sequence[FloatArray],
        done: Callable[[int], None] = lambda _: None,
    ) -> list[Minimum]:
        """The end of each start (n,), clipped into the bounds; ``done`` is told how many ended.

        Where two have ended nowhere at one cost, no more are tried.
        """
        ends: list[Minimum] = []
        for start in starts:
            ends.append(self.minimise(nlp, start))
            if hopeless(ends):
                done(len(starts))
                break
            done(len(ends))
        return ends

    def _checked(self, nlp: RobustNlp, z: FloatArray) -> Answer:
        """What the search answers, with its cost, where it can be used."""
        before = nlp.cost(z)
        try:
            answer = self.search(nlp, z.copy())
        except (SutaCalibError, KeyboardInterrupt):
            raise
        except Exception as problem:
            raise SolverError(
                f"{type(problem).__name__} ({problem})", "an Answer", where=self._who
            ) from problem
        if not isinstance(answer, Answer):
            raise SolverError(repr(answer), "an Answer", where=self._who)
        try:
            there = np.asarray(answer.z, dtype=float)
        except (TypeError, ValueError):
            raise SolverError(repr(answer.z), "numbers", where=f"{self._who}: z") from None
        if there.shape != z.shape:
            raise SolverError(f"shape {there.shape}", f"shape {z.shape}", where=f"{self._who}: z")
        if not np.isfinite(there).all():
            raise SolverError("NaN or infinity", "finite numbers", where=f"{self._who}: z")
        there = np.clip(there, nlp.lower, nlp.upper)
        cost = nlp.cost(there)
        # Of the cost at the start: what rounding may add to it.
        if not cost <= before + 1e-9 * abs(before):
            raise SolverError(
                f"a cost of {cost:.6g}",
                f"at most {before:.6g}, that of the start",
                where=self._who,
                hint="minimise nlp.cost over z within nlp.lower and nlp.upper",
            )
        return replace(answer, z=there, converged=bool(answer.converged), cost=cost)

    @property
    def _who(self) -> str:
        return f"the solver {self.name}"


def hopeless(ends: Sequence[Minimum]) -> bool:
    """Whether all starts, and more than one, have ended nowhere, and there at the same cost."""
    if len(ends) < 2 or any(end.converged for end in ends):
        return False
    lowest, next_ = sorted(end.cost for end in ends)[:2]
    # Share by which the costs of two ends that are no minimum differ at most to be the same.
    return next_ - lowest < 1e-4 * next_
