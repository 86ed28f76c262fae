"""What is proven of an answer's being the best one, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from suta_calib.pose_calibration.rotation_bound import PROVEN
from suta_calib.units import deg, text


@dataclass(frozen=True)
class Optimality:
    """What is proven of an answer.

    Attributes:
        what: the unknowns, in words.
        gap: how much lower than the lowest sum of squares that was found any may be, relative to
            it: zero but for rounding where the convex relaxation is tight.
        answer_gap: the same of the answer, whose robust cost is another one where the hand's turns
            move the target: lever and axes follow the answer there, and are held here.
        moved: from that minimum to the answer, m, of whichever moved most.
        turned: the same, rad; None without rotations.
        reached: whether the answer's own cost, descended from there, ends in the answer.
        method: what proves it: ``linear`` where nothing but positions is unknown, so that there is
            one minimum only; ``eigenvalues`` of a matrix in closed form; or a semidefinite
            ``program``.
        trouble: why it is not proven; empty where there is no more to say.
        held: what of the answer is held, in words.
    """

    what: str
    gap: float
    answer_gap: float
    moved: float
    turned: float | None
    reached: bool
    method: Literal["linear", "eigenvalues", "program"] = "eigenvalues"
    trouble: str = ""
    held: str = "the weights"

    @property
    def certified(self) -> bool:
        """Whether the minimum is proven, and leads to the answer."""
        return self.gap <= PROVEN and self.reached

    @property
    def sentence(self) -> str:
        """What is proven in words, or that it is not, and what that means."""
        moved = text(self.moved, "m", with_unit=True)
        moved += "" if self.turned is None else f" and {deg(self.turned):.2g}°"
        if self.certified and self.method == "linear":
            return (
                f"Proven best: the residuals are linear in {self.what}. Such a cost has only one "
                f"minimum, and this is it (to {max(self.gap, 1e-15):.0e} of the cost)."
            )
        if self.certified:
            there = (
                "This answer is that minimum."
                if self.answer_gap <= PROVEN
                else f"From that minimum the robust cost leads to this answer, {moved} away."
            )
            by = "the eigenvalues of a matrix"
            if self.method == "program":
                by = "a semidefinite program, and the eigenvalues of a matrix"
            return (
                f"Proven best, by {by}: with {self.held} of this answer, no other {self.what} have "
                f"a lower sum of squares (to {max(self.gap, 1e-15):.0e} of it). {there}"
            )
        if self.gap <= PROVEN:
            return (
                f"Not proven best: the lowest sum of squares is known, {moved} away, but from "
                "there the robust cost leads to another minimum than this answer. Are many rows "
                "wrong? Look at the rows that were left out."
            )
        because = f": {self.trouble}" if self.trouble else ""
        return (
            f"Not proven best: another {self.what} may fit better (by up to {self.gap:.1g} of the "
            f"sum of squares; {PROVEN:.0e} counts as proven){because}. The answer is the lowest "
            "minimum that was found, and may still be right. Calibrate with a second set of rows, "
            "turned about other axes: if both give the same, use it."
        )


@dataclass(frozen=True)
class PictureOptimality:
    """What is proven of an answer from pictures, whose own cost has no convex bound.

    Attributes:
        poses_certified: whether the closed problem on the board's poses, from which the answer
            starts, is proven.
        poses_gap: the largest gap of any camera's, as `Optimality.gap`.
        reached: whether the reprojection errors, followed downhill from there, end in the answer.
    """

    poses_certified: bool
    poses_gap: float
    reached: bool

    @property
    def good(self) -> bool:
        """Whether all is so that can be."""
        return self.poses_certified and self.reached

    @property
    def sentence(self) -> str:
        """What is proven in words, and what is not."""
        start = (
            "The start is proven best: with the board's pose by each picture, no other X and Z "
            f"have a lower sum of squares (to {max(self.poses_gap, 1e-15):.0e} of it)."
            if self.poses_certified
            else "Nor is the start, the board's pose by each picture, proven best."
        )
        end = (
            "The reprojection errors lead from there to this answer."
            if self.reached
            else "From there the reprojection errors lead to another minimum than this answer. "
            "Look at the pictures that were left out, and add others."
        )
        return f"Not proven best: reprojection errors have no convex bound. {start} {end}"
