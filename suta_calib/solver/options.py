"""Options of a solve."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from numbers import Integral
from typing import Final

from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, did_you_mean
from suta_calib.solver.gauss_newton import GaussNewton
from suta_calib.solver.interface import Solver
from suta_calib.solver.ipopt import Ipopt

HESSIANS: Final = ("gauss-newton", "exact")


@dataclass(frozen=True)
class WeightOptions:
    """What is believed of noise levels and priors beforehand: logarithmic standard deviations.

    Attributes:
        stated: of a noise level that the job states; a data sheet is right within a factor of two.
        assumed: of one that nobody stated.
        common: of the factor common to all priors; a guess is right within one of ten.
        between: of a group's factor about the common one: whoever guesses one size too small is
            likely to guess the others so. Free factors would let groups of few parameters run away.
        camera: of the factor on what is known of a camera: what its calibration says of itself, or
            what calibrations usually are, is right within one of three.
    """

    stated: float = math.log(2.0)
    assumed: float = math.log(10.0)
    common: float = math.log(10.0)
    between: float = 0.2
    camera: float = math.log(3.0)


@dataclass(frozen=True)
class SolverOptions(Displayable):
    """Options of the minimisation.

    Attributes:
        starts: number of starting points; the first is nominal.
        seed: of the other starting points.
        solver: what minimises, whatever ``hessian``, ``max_iterations`` and ``confirm`` say.
        hessian: ``gauss-newton`` or ``exact``, second derivatives by automatic differentiation.
        max_iterations: of each method, per start.
        weights: how far learned noise levels and prior sizes may be from given ones; None to take
            what was given.
        confirm: whether IPOPT goes on from the lowest end of Gauss-Newton steps. It is another
            method's word for the minimum, which refits by the thousand can do without.
    """

    starts: int = 1
    seed: int = 0
    hessian: str = "gauss-newton"
    max_iterations: int = 200
    weights: WeightOptions | None = field(default_factory=WeightOptions)
    confirm: bool = True
    solver: Solver | None = None

    def __post_init__(self) -> None:
        for name, least in (("starts", 1), ("seed", 0), ("max_iterations", 1)):
            value = getattr(self, name)
            if not isinstance(value, Integral) or value < least:
                expected = f"a whole number from {least} on"
                raise ParameterError(repr(value), expected, where=f"SolverOptions: {name}")
        if self.hessian not in HESSIANS:
            hint = did_you_mean(str(self.hessian), HESSIANS)
            found = f"the Hessian {self.hessian!r}"
            raise ParameterError(found, " or ".join(HESSIANS), hint=hint)

    def build_solver(self) -> Solver:
        """The solver that these options ask for; there is no other place that makes one.

        Raises:
            ParameterError: something else than a solver.
        """
        if self.solver is not None:
            if not isinstance(self.solver, Solver):
                raise ParameterError(repr(self.solver), "an object of a subclass of Solver")
            return self.solver
        if self.hessian == "exact":
            return Ipopt(exact=True, max_iterations=self.max_iterations)
        return GaussNewton(self.max_iterations, self.confirm)
