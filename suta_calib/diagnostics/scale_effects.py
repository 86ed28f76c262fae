"""What carries the scale of a calibrated arm, and what its uncertainty does at the tip.

No residual shows a common factor on everything that was measured with. It is known by a grade or a
stated number alone, so an answer names it, with what one standard deviation of it means.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from suta_calib.diagnostics.common_scale import relied_on
from suta_calib.diagnostics.tip_motion import tip_motion
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.scale import LengthScale
from suta_calib.records import dataclass
from suta_calib.solver.solution import Solution
from suta_calib.terms.length_scale import scale_carriers
from suta_calib.units import text

# Shift of the tip, m, below which a scale means nothing at the tip.
NOTHING: Final = 1e-9


@dataclass(frozen=True)
class ScaleEffect:
    """One thing that gives observations their unit of length.

    Attributes:
        what: ``artefact``, ``board`` or ``instrument``.
        name: tells several of one sort apart.
        scale: how well it is known.
        carries: whether the arm's lengths rest on it, because the data tell it less well.
        tip: by how much the tip moves with one standard deviation of it, m, root mean square over
            the fitted postures.
    """

    what: str
    name: str
    scale: LengthScale
    carries: bool
    tip: float

    @property
    def sentence(self) -> str:
        """That it carries the scale, how well it is known, and what that is at the tip."""
        return (
            f"The {self.what} carries the scale of the arm's lengths, and no residual checks it "
            f"({self.scale.sentence}, one sigma): that is {text(self.tip, 'm', with_unit=True)} at "
            "the tip, and every ± holds it."
        )


@lru_cache(maxsize=4)
def scale_effects(solution: Solution) -> tuple[ScaleEffect, ...]:
    """Every carrier of a scale among the observations; none where they know no length.

    Args:
        solution: a converged one, of terms over an arm.
    """
    problem, by_scale = solution.problem, solution.spread.by_scale
    arm = problem.names[: problem.arm_count]
    carried, effects = relied_on(solution), []
    for carrier in scale_carriers(problem.terms):
        key = carrier.what, carrier.name
        shift = carrier.scale.std * by_scale[key]
        moved = tip_motion(problem, solution.x, dict(zip(arm, shift.tolist(), strict=False)))
        tip = rms_length(moved.linear)
        effects.append(
            ScaleEffect(
                carrier.what,
                carrier.name,
                carrier.scale,
                key in carried,
                tip if tip > NOTHING else 0.0,
            )
        )
    return tuple(effects)
