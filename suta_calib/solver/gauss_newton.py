"""The default solver: Gauss-Newton steps, confirmed by IPOPT."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, final

from suta_calib.arrays import FloatArray
from suta_calib.solver.descent import NEGLIGIBLE
from suta_calib.solver.interface import JOINED, SETTLED, Answer, Minimum, Solver
from suta_calib.solver.ipopt import Ipopt
from suta_calib.solver.nlp import SAME_COST, RobustNlp


@final
@dataclass(frozen=True)
class GaussNewton(Solver):
    """Steps within bounds (`descent`); IPOPT goes on from where they do not settle.

    A start that comes to a minimum which an earlier one has found, or would by its next step, ends
    there: what would follow is known. Of very many rows, steps over part of them come first.

    Attributes:
        max_iterations: of each method, per start.
        confirm: whether IPOPT goes on from the lowest end: another method's word for the minimum,
            which refits by the thousand can do without.
        settled: share of the cost that steps may promise to lose where the next is the last.
    """

    name: ClassVar[str] = "Gauss-Newton"
    checks_itself: ClassVar[bool] = True

    max_iterations: int = 200
    confirm: bool = True
    settled: float = NEGLIGIBLE

    def search(self, nlp: RobustNlp, z: FloatArray) -> Answer:
        """Steps to a minimum, or IPOPT from where they end."""
        near = nlp.by_part(z)
        there = nlp.descend(near, settled=self.settled, steps=self.max_iterations, join=True)
        if not there.settled:
            return self._ipopt.search(nlp, there.z)
        status = SETTLED if there.joined is None else JOINED
        return Answer(there.z, True, status, there.steps, cost=there.cost)

    def nearby(self, nlp: RobustNlp, start: FloatArray) -> Minimum | None:
        """Where steps alone come to; None where they do not settle."""
        return self._ipopt.nearby(nlp, start)

    def confirmed(self, nlp: RobustNlp, minimum: Minimum) -> Minimum:
        """The same minimum with IPOPT's word for it, or the lower one that IPOPT went on to.

        Left as it is where it is IPOPT's already, or where rounding alone keeps IPOPT from an
        answer: one that goes on to lower costs without an end says that it was no minimum.
        """
        if not self.confirm or not len(nlp.free) or minimum.status != SETTLED:
            return minimum
        by_ipopt = self._ipopt.minimise(nlp, minimum.x)
        if not by_ipopt.converged and not by_ipopt.cost < minimum.cost - SAME_COST:
            return minimum
        steps = minimum.iterations + by_ipopt.iterations
        if by_ipopt.cost < minimum.cost:
            return replace(by_ipopt, iterations=steps)
        return replace(by_ipopt, x=minimum.x, cost=minimum.cost, iterations=steps)

    @property
    def _ipopt(self) -> Ipopt:
        return Ipopt(max_iterations=self.max_iterations)
