"""What carries the scale of a calibrated arm, and what its uncertainty does at the tip.

No residual shows a common factor on everything that was measured with. It is known by a grade or a
stated number alone, so an answer names it, with what one standard deviation of it means.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.scale import LengthScale
from suta_calib.solver.held_geometry import HeldGeometry
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.length_scale import scale_carriers
from suta_calib.trust.common_scale import FOLLOWS, SHORTEST, relied_on
from suta_calib.trust.tip_motion import tip_motion
from suta_calib.units import text
from suta_calib.words import listed

# What it is called where a length that a job holds is all that has a unit.
HELD: Final = "held length"
# What is to be done with something printed.
MEASURE: Final = {
    "artefact": "Measure the artefact along x and along y with a steel ruler, and write both into "
    "its file (measured_mm: [x, y], between the outer landmarks).",
    "board": "Measure the board with a steel ruler over as many squares as it has, and write into "
    "its file the length of one (square_mm) and how well you measured (scale_ppm: 1000 for 0.2 mm "
    "over 200 mm).",
}


@dataclass(frozen=True)
class ScaleEffect:
    """One thing that gives observations their unit of length.

    Attributes:
        what: ``artefact``, ``board``, ``instrument``, or ``held length``.
        name: tells several of one sort apart; of what is held, the parameter.
        scale: how well it is known.
        carries: whether the arm's lengths rest on it, because the data tell it less well.
        bends: whether what is estimated follows it, though the long lengths do not.
        tip: by how much the tip moves with one standard deviation of it, m, root mean square over
            the fitted postures.
    """

    what: str
    name: str
    scale: LengthScale
    carries: bool
    tip: float
    bends: bool = False

    @property
    def guessed(self) -> bool:
        """Whether it rests on a printed artefact or board that nobody measured."""
        printed = self.what in MEASURE and self.scale.grade == "printed"
        return printed and not self.scale.measured

    def unseen_in(self, errors: float) -> str:
        """What held-out errors of this size, m, do not show of it, and the remedy."""
        return (
            f"{self.sentence} The validation error ({text(errors, 'm', with_unit=True)}) does not "
            f"show it, because it was measured with the same {self.what}. {MEASURE[self.what]}"
        )

    @property
    def sentence(self) -> str:
        """That it carries the scale, how well it is known, and what that is at the tip."""
        if self.what == HELD:
            return (
                f"No observation measures a length. All lengths of the arm depend on {self.name}, "
                "which keeps its URDF value and carries the scale. The standard deviation of this "
                f"scale ({self.scale.sentence}) is {text(self.tip, 'm', with_unit=True)} at the "
                f"tip, and every ± includes it. State how good the drawing is (arm: {{grade: …}}), "
                "estimate this length with prior_mm, or measure a length."
            )
        if self.bends:
            return (
                f"The estimated parameters follow the scale of the {self.what}, although the arm's "
                "long lengths do not. Residuals hardly show an error of this scale. Its standard "
                f"deviation ({self.scale.sentence}) is {text(self.tip, 'm', with_unit=True)} at "
                "the tip, and every ± includes it. If the scale is wrong by 1 %, the tip is wrong "
                f"by {text(self.tip / self.scale.std / 100, 'm')} mm."
            )
        return (
            f"The {self.what} carries the scale: if it is 1 % too long, so is the arm, and no "
            f"residual shows it. The standard deviation of this scale ({self.scale.sentence}) is "
            f"{text(self.tip, 'm', with_unit=True)} at the tip, and every ± includes it."
        )


def scale_effects(solution: Solution) -> tuple[ScaleEffect, ...]:
    """Every carrier of a scale among the observations; none where they know no length."""
    problem, by_scale, left = solution.problem, solution.spread.by_scale, solution.spread.scale_std
    arm = problem.names[: problem.arm_count]
    carried, effects = relied_on(solution), []
    # Shift of the tip, m, below which a scale means nothing at the tip.
    nothing = 1e-9
    for carrier in scale_carriers(problem.terms):
        key = carrier.what, carrier.name
        # Residuals tell a scale where they halve what is stated of it: it is no longer taken on
        # trust. Of what is estimated as a stretch the answer has the ± itself.
        told = left[key] < 0.5 * carrier.std
        shift = (left[key] if told else carrier.scale.std) * by_scale[key]
        moved = tip_motion(problem, solution.x, dict(zip(arm, shift.tolist(), strict=False)))
        tip = rms_length(moved.linear)
        # As a part of the factor by which the tip's places would grow about their middle.
        size = rms_length(moved.position - moved.position.mean(axis=0))
        bends = key not in carried and not told
        bends = bends and tip > FOLLOWS * carrier.scale.std * size > 0.0
        effects.append(
            ScaleEffect(
                carrier.what,
                carrier.name,
                carrier.scale,
                key in carried or bends,
                tip if tip > nothing else 0.0,
                bends,
            )
        )
    held = held_scale(problem, solution.spread.held)
    return tuple(effects) if held is None else (*effects, held)


def held_scale(problem: Problem, held: HeldGeometry | None) -> ScaleEffect | None:
    """The held length that carries the scale; None where observations know lengths."""
    if held is None or problem.arm is None or scale_carriers(problem.terms) or not held.is_scale:
        return None
    if _shows_no_place(problem):
        return None
    tip = float(np.linalg.norm(held.tip))
    # The longest has most of the arm's size in it.
    k = int(np.argmax(np.abs(held.nominal)))
    if abs(held.nominal[k]) < SHORTEST:
        return None
    relative = float(held.tolerance[k] / abs(held.nominal[k]))
    return ScaleEffect(HELD, held.names[k], LengthScale(relative, problem.arm.grade), True, tip)


def _shows_no_place(problem: Problem) -> bool:
    """Whether nothing but directions is observed: no estimate then hangs on a length."""
    return all(block.unit == "rad" for block in problem.blocks)


def held_unseen(solution: Solution) -> str:
    """What no residual shows of held geometry, where that is not the scale; empty if nothing."""
    held = solution.spread.held
    if held is None or not held.matters or held_scale(solution.problem, held):
        return ""
    if held.is_scale and _shows_no_place(solution.problem):
        return ""
    tip = text(float(np.linalg.norm(held.tip)), "m", with_unit=True)
    return (
        f"{listed(held.carriers)} "
        f"{'keeps its URDF value' if len(held.carriers) == 1 else 'keep their URDF values'}, and "
        "no residual shows an error there. If the drawing is as good there as elsewhere, this "
        f"error is {tip} at the tip (one standard deviation), and every ± includes it. State how "
        f"good the drawing is (arm: {{grade: …}}), or estimate more with prior_mm and prior_deg."
    )
