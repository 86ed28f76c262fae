"""Why the data cannot tell a parameter, in the words of the person who takes the measurements."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length, skew
from suta_calib.model.parameters import COMPLIANCE, POSITION, Parameter
from suta_calib.solver.identifiability import Combination, Identification
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS
from suta_calib.terms.term import Gap
from suta_calib.units import Unit, shown

# What an angle is worth beside a length, m: the size of a tool or an artefact.
LEVER: Final = 0.25
# A part or a misfit this small beside the whole is put there by noise.
NOISE: Final = 0.05
# Parts that cancel to this share of the largest one cancel.
CANCELS: Final = 0.02
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


# ── what a change of the parameters does to the tip, sample by sample ────────────────────────
@dataclass(frozen=True, eq=False)
class TipMotion:
    """Velocities of the tip at every sample when the parameters move along one direction.

    Attributes:
        position: (n, 3) of the tip in the base, m.
        rotation: (n, 3, 3) of the tip in the base.
        linear: (n, 3) velocity of the tip in the base, m per unit of the direction.
        angular: (n, 3) angular velocity in the base, rad per unit.
        parts: effect of each parameter by itself, m per unit: root mean square over the samples,
            angles at `LEVER`.
    """

    position: FloatArray
    rotation: FloatArray
    linear: FloatArray
    angular: FloatArray
    parts: dict[str, float]

    @property
    def size(self) -> float:
        """Root mean square of the whole motion, m per unit, angles at `LEVER`."""
        return float(np.hypot(_rms(self.linear), LEVER * _rms(self.angular)))

    @property
    def main(self) -> tuple[str, ...]:
        """The parameters that do the moving, strongest first: the others are noise."""
        largest = max(self.parts.values(), default=0.0)
        kept = [name for name, size in self.parts.items() if size >= NOISE * largest]
        return tuple(sorted(kept, key=lambda name: -self.parts[name]))

    @property
    def vanishes(self) -> bool:
        """Whether the parts cancel, so that nothing moves at all."""
        return self.size <= CANCELS * max(self.parts.values(), default=0.0)

    @property
    def turns_in_place(self) -> bool:
        """Whether the tip turns but stays where it is."""
        return _rms(self.linear) <= NOISE * LEVER * _rms(self.angular)

    def base_twist(self) -> tuple[FloatArray, FloatArray, float]:
        """The one rigid motion of the base that explains all samples best: v, ω and the misfit.

        Returns:
            Velocity (3,) of the base's origin and angular velocity (3,), in the base, per unit;
            and what they leave unexplained as a part of the whole, 0 … 1.
        """
        omega = self.angular.mean(axis=0)
        v = (self.linear - np.cross(omega, self.position)).mean(axis=0)
        left = self.linear - v - np.cross(omega, self.position)
        return v, omega, self._misfit(left, self.angular - omega)

    def tool_twist(self) -> tuple[FloatArray, FloatArray, float]:
        """The same for a motion of the tip that is always the same in the tip's own frame."""
        linear = np.einsum("nji,nj->ni", self.rotation, self.linear)
        angular = np.einsum("nji,nj->ni", self.rotation, self.angular)
        v, omega = linear.mean(axis=0), angular.mean(axis=0)
        return v, omega, self._misfit(linear - v, angular - omega)

    def rigid_per_group(self, groups: FloatArray) -> float:
        """Misfit of one rigid motion per group (n,): what the touched points alone would show."""
        left = np.zeros_like(self.linear)
        for group in np.unique(groups):
            rows = np.flatnonzero(groups == group)
            p = self.position[rows] - self.position[rows].mean(axis=0)
            design = np.concatenate(
                [np.tile(np.eye(3), (len(rows), 1, 1)), -skew(p)], axis=2
            ).reshape(-1, 6)
            flat = self.linear[rows].reshape(-1)
            twist = np.linalg.lstsq(design, flat, rcond=1e-9)[0]
            left[rows] = (flat - design @ twist).reshape(-1, 3)
        return _rms(left) / max(_rms(self.linear), 1e-300)

    def _misfit(self, linear: FloatArray, angular: FloatArray) -> float:
        left = float(np.hypot(_rms(linear), LEVER * _rms(angular)))
        return left / max(self.size, 1e-300)


def tip_motion(problem: Problem, x: FloatArray, direction: Mapping[str, float]) -> TipMotion:
    """Push a direction of the arm's parameters through the forward kinematics.

    Args:
        problem: whose samples are visited.
        x: (n,) parameters to linearise at.
        direction: change of each parameter, m or rad per unit; names of others are ignored.
    """
    problem.linearise(x, problem.assumed_sigmas())
    table, names = problem.evaluation.table, problem.names[: problem.arm_count]
    columns = {
        name: (table.velocity[:, k] * direction[name]).reshape(-1, 6)
        for k, name in enumerate(names)
        if name in direction
    }
    total = sum(columns.values(), np.zeros((len(table.position), 6)))
    parts = {
        name: float(np.hypot(_rms(c[:, :3]), LEVER * _rms(c[:, 3:]))) for name, c in columns.items()
    }
    rotation = np.swapaxes(table.rotation.reshape(-1, 3, 3), 1, 2).copy()
    return TipMotion(table.position.copy(), rotation, total[:, :3], total[:, 3:], parts)


def placement_groups(problem: Problem) -> FloatArray:
    """(n,) one number per set of samples whose common motion its own unknowns make up for."""
    keys: list[tuple[object, ...]] = []
    for k, term in enumerate(problem.terms):
        labels = term.poses.samples.labels
        columns = [labels[name] for name in (term.place, "repeat") if name in labels]
        keys += [(k, *(str(c[row]) for c in columns)) for row in range(len(term.poses))]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    return np.array([number[key] for key in keys], dtype=float)


def _rms(vectors: FloatArray) -> float:
    return rms_length(vectors) if len(vectors) else 0.0
