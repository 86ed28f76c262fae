"""Why the data cannot tell a parameter, in the words of the person who takes the measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.tip_motion import LEVER, NOISE, TipMotion, placement_groups, tip_motion
from suta_calib.model.parameters import COMPLIANCE, POSITION, Parameter
from suta_calib.solver.identifiability import Combination, Identification
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS
from suta_calib.terms.term import Gap
from suta_calib.units import Unit, shown

_NO_REMEDY: Final = "none needed: only the combination matters"
_MOST_NAMES: Final = 4


@dataclass(frozen=True)
class Explanation:
    """Why one parameter is held at nominal.

    Attributes:
        fixed: its name.
        sentence: what the undetermined direction does, so that no observation sees it.
        remedy: what to measure, or to decide, to get rid of it.
    """

    fixed: str
    sentence: str
    remedy: str


@dataclass(frozen=True, eq=False)
class _Case:
    """One combination with everything the rules look at."""

    problem: Problem
    combination: Combination
    motion: TipMotion
    spread: float

    @property
    def fixed(self) -> str:
        return self.combination.fixed

    @property
    def parameter(self) -> Parameter:
        return self.problem.parameters[self.fixed]

    @property
    def others(self) -> str:
        """The parameters that move with the fixed one; empty where it is alone."""
        names = [n for n in self.motion.main if n != self.fixed]
        if len(names) > _MOST_NAMES:
            return ", ".join([*names[:_MOST_NAMES], "…"])
        return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))

    def says(self, does: str, remedy: str) -> Explanation:
        """``does`` follows the fixed parameter, and whatever changes with it."""
        together = f" together with {self.others}" if self.others else ""
        return Explanation(self.fixed, f"{self.fixed}{together} {does}", remedy)


def explain(
    problem: Problem, x: FloatArray, identification: Identification
) -> tuple[Explanation, ...]:
    """A sentence and a remedy for every combination of an identification.

    Args:
        problem: what was asked about.
        x: (n,) parameters the identification was made at.
        identification: whose combinations are explained, in their order.

    Returns:
        One explanation per combination: found by pushing it through the forward kinematics and
        looking at how the tip moves at the samples, with a tolerance for noise.
    """
    if not identification.combinations:
        return ()
    information = predicted_information(problem, x, problem.assumed_sigmas())
    return tuple(_explain(problem, x, c, information) for c in identification.combinations)


def _explain(
    problem: Problem, x: FloatArray, combination: Combination, information: Information
) -> Explanation:
    if combination.fixed not in problem.names[: problem.arm_count]:
        return _own(problem.parameters[combination.fixed], combination)
    motion = tip_motion(problem, x, combination.direction)
    spread = _spread(problem, combination.direction, information)
    case = _Case(problem, combination, motion, spread)
    for rule in (_beside_geometry, _same_thing, _turns_tip, _rigid, _per_placement):
        if (found := rule(case)) is not None:
            return found
    return _hardly(case)


def _own(parameter: Parameter, combination: Combination) -> Explanation:
    """An unknown of a term: where the artefact or the instrument stands."""
    label, fixed = parameter.owner, combination.fixed
    others = [name for name in combination.direction if name != fixed]
    subject = f"{fixed} together with {', '.join(others)}" if others else fixed
    does = f"changes {label} in a way that its samples hardly show"
    remedy = "to know it too, spread its samples wider"
    if any(
        kind.needs_artefact and label.startswith(f"{kind.place_unknown}[")
        for kind in KINDS.values()
    ):
        does = (
            f"turns the artefact about a line through the landmarks touched at {label}, which "
            "moves none of them"
        )
        remedy = "to know this pose too, touch a landmark off that line"
    return Explanation(fixed, f"{subject} {does}", f"none needed for the arm; {remedy}")


def _beside_geometry(case: _Case) -> Explanation | None:
    """An eccentricity or a compliance that the visited readings do not show."""
    parameter = case.parameter
    if not case.motion.vanishes or parameter.geometric:
        return None
    if case.others:
        does = f"does the same as {case.others} at the readings visited"
        return Explanation(case.fixed, f"{case.fixed} {does}", f"turn {parameter.owner} farther")
    if parameter.key != COMPLIANCE:
        return None
    does = "does nothing at the postures visited: gravity has no torque about its axis"
    return Explanation(case.fixed, f"{case.fixed} {does}", "none needed while the arm stands so")


def _same_thing(case: _Case) -> Explanation | None:
    if not case.motion.vanishes:
        return None
    keys = {case.problem.parameters[name].key for name in case.motion.main}
    if keys <= set(POSITION):
        does = "does the same as {others}: together they slide a joint's frame along its own axis"
    elif not keys & set(POSITION):
        does = "does the same as {others}: together they turn a joint's frame about its own axis"
    else:
        does = "makes up for {others}: together they move a joint's frame, not the tip"
    sentence = f"{case.fixed} {does.format(others=case.others or 'another parameter')}"
    return Explanation(case.fixed, sentence, _NO_REMEDY)


def _turns_tip(case: _Case) -> Explanation | None:
    if not case.motion.turns_in_place:
        return None
    does = "turns the tip without moving it, and no observation looks at the tip's orientation"
    return case.says(
        does, "none needed if only the tip's position matters; else measure its orientation"
    )


def _rigid(case: _Case) -> Explanation | None:
    """One rigid motion for all samples: of the whole arm in the base, or of the tip in the tool."""
    v_base, w_base, base_misfit = case.motion.base_twist()
    v_tool, w_tool, tool_misfit = case.motion.tool_twist()
    in_base, in_tool = base_misfit < NOISE, tool_misfit < NOISE
    # With a tool that never tilts both fit: then the parameters' place in the chain decides.
    if in_base and in_tool:
        assert case.problem.arm is not None
        order = [segment.owner for segment in case.problem.arm.segments]
        main = case.motion.main
        strongest = case.problem.parameters[main[0]].owner if main else order[0]
        in_base = order.index(strongest) < 0.5 * max(len(order) - 1, 1)
        in_tool = not in_base
    if in_base:
        return _base(case, v_base, w_base)
    return _tool(case, v_tool, w_tool) if in_tool else None


def _base(case: _Case, v: FloatArray, omega: FloatArray) -> Explanation:
    turning = float(np.linalg.norm(omega)) * LEVER > NOISE * case.motion.size
    does = (
        f"turns the whole arm about the base's {_axis(omega)}"
        if turning
        else f"shifts the whole arm along the base's {_axis(v)}"
    )
    for term in case.problem.terms:
        if "base" in term.leaves_open:
            why, remedy = term.leaves_open["base"]
            return case.says(f"{does}: {why}", remedy)
    return case.says(
        f"{does}: measurements relative to an artefact or a point that stands anywhere cannot see "
        "where the arm stands (base gauge)",
        f"choose it by convention (leave it at nominal), or {_would_tell('base')}",
    )


def _tool(case: _Case, v: FloatArray, omega: FloatArray) -> Explanation:
    terms = case.problem.terms
    if all("tool" in term.leaves_open for term in terms):
        return case.says(*terms[0].leaves_open["tool"])
    if float(np.linalg.norm(omega)) * LEVER <= NOISE * case.motion.size:
        return case.says(
            f"changes the tool's length along the tip's {_axis(v)}: this cancels out of every "
            "distance because the tool always has the same direction relative to the artefact",
            f"{_would_tell('tool')}, or tilt the tool against the artefact",
        )
    return case.says(
        f"redefines the tip frame (a turn about the tip's {_axis(omega)}), and every observation "
        "fits as well",
        "measure the tip's orientation (landmarks with rotation_rpy_deg, or an instrument that "
        "gives one)",
    )


def _per_placement(case: _Case) -> Explanation | None:
    if case.motion.rigid_per_group(placement_groups(case.problem)) > NOISE:
        return None
    return case.says(
        "moves all points touched at one place together, and the unknown pose of that place makes "
        "up for it",
        f"touch points farther apart within each placement, or {_would_tell('place')}",
    )


def _would_tell(gap: Gap) -> str:
    """What kinds of observation advise, each to close the gap."""
    return " or ".join(kind.tells[gap] for kind in KINDS.values() if gap in kind.tells)


def _hardly(case: _Case) -> Explanation:
    parameter = case.parameter
    plausible = _amount(parameter.plausible, parameter.unit)
    would = (
        f"predicted ±{_amount(case.spread, parameter.unit)} against ±{plausible} plausible"
        if math.isfinite(case.spread)
        else f"±{plausible} plausible, and nothing measured changes with it"
    )
    assert case.problem.arm is not None
    # The moving joint whose excitation would tell: the last one at or before the parameter.
    segments, joint = case.problem.arm.segments, ""
    for segment in segments:
        joint = joint if segment.motion == "fixed" else segment.owner
        if segment.owner == parameter.owner and joint:
            break
    else:
        joint = case.problem.arm.joints[0]
    return case.says(
        f"hardly changes anything measured at the visited poses ({would})",
        f"visit poses that differ more in {joint}, or hold it by a prior",
    )


def _spread(problem: Problem, direction: Mapping[str, float], information: Information) -> float:
    """Predicted standard deviation along a direction, in the fixed parameter's unit."""
    a = problem.arm_count
    d = np.array([direction.get(name, 0.0) for name in problem.names])
    curvature = information.curvature
    pushed = curvature @ d
    squared = float(d @ pushed)
    if len(d) > a:
        inverse = np.linalg.pinv(curvature[a:, a:], 1e-11, True)
        squared -= float(pushed[a:] @ inverse @ pushed[a:])
    # Below rounding of the sum it came from, it says nothing.
    floor = 1e-12 * float(np.abs(d) @ np.abs(curvature) @ np.abs(d))
    return 1.0 / math.sqrt(squared) if squared > floor else math.inf


def _axis(vector: FloatArray) -> str:
    """``z axis``, or the direction's numbers where it is along none of the axes."""
    unit = vector / max(float(np.linalg.norm(vector)), 1e-300)
    largest = int(np.argmax(np.abs(unit)))
    if abs(unit[largest]) > math.cos(math.radians(5.0)):
        return f"{'xyz'[largest]} axis"
    return "direction ({:.2f}, {:.2f}, {:.2f})".format(*unit)


def _amount(value: float, unit: Unit) -> str:
    number = f"{shown(value, unit):.3g}"
    return f"{number} mm" if unit == "m" else f"{number}°{'/Nm' if unit == 'rad/Nm' else ''}"
