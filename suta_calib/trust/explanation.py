"""Why the data do not determine a parameter, in the words of the person who measures.

Three things are kept apart. *Redundant*: no data of these kinds could tell it, and nothing but a
convention hangs on it. *Untold*: other data of these kinds, or of others, would tell it. *Badly
told*: these data say something, but less than is worth reporting. Advice is given only where rich
data that follow it would tell the parameter (`RichData`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import attempt
from suta_calib.display import Displayable
from suta_calib.model.parameters import (
    BACKLASH,
    BENDING,
    COMPLIANCE,
    DECAY,
    EXPANSION,
    GEAR_RATIO,
    HYSTERESIS,
    MASS,
    POSITION,
    RIPPLE,
    Parameter,
)
from suta_calib.solver.identifiability import WEAK, Combination, Identification
from suta_calib.solver.information import Information, predicted_information
from suta_calib.solver.problem import Problem
from suta_calib.terms import KINDS, Term
from suta_calib.terms.term import Gap
from suta_calib.threads import single_threaded
from suta_calib.trust.rich_data import LEVER, RichData
from suta_calib.trust.tip_motion import NOISE, TipMotion, placement_groups, tip_motion
from suta_calib.units import Unit, shown
from suta_calib.words import enumerated

HeldReason = Literal["redundant", "untold", "badly told"]
# Words of an advice, and the information that following it would bring.
Advice = tuple[str, Callable[[], FloatArray]]


@dataclass(frozen=True)
class Explanation(Displayable):
    """Why one parameter is held at nominal.

    Attributes:
        fixed: its name.
        sentence: what the undetermined direction does, so that no observation sees it.
        remedy: what to measure, or to decide, to get rid of it.
        told: whether it is redundant, or how far the data tell it.
        moves: by how much the registered tip is off in postures all over the range, per unit by
            which the parameter is, with what makes up for it to the data; m per m or rad.
        failed: whether the reason could not be computed; the sentence says why.
    """

    fixed: str
    sentence: str
    remedy: str
    reason: HeldReason = "untold"
    moves: float = 0.0
    failed: bool = False

    @property
    def as_drawn(self) -> bool:
        """Whether it is redundant, and the tip depends on it all the same: no convention."""
        return self.reason == "redundant" and self.moves > 0.0


@dataclass(frozen=True, eq=False)
class _Case:
    """One combination with everything the rules look at.

    Attributes:
        motion: of the tip along it.
        spread: predicted standard deviation along it, in the fixed parameter's unit.
        directions: (n, k) it and what else is open, in plausible units, for ``rich``.
        redundant: whether no data of these kinds could tell it.
    """

    problem: Problem
    fixed: str
    motion: TipMotion
    spread: float
    rich: RichData
    directions: FloatArray
    redundant: bool

    @property
    def parameter(self) -> Parameter:
        return self.problem.parameters[self.fixed]

    @property
    def partners(self) -> str:
        """The parameters that move with the fixed one; empty where it is alone."""
        names = [n for n in self.motion.main if n != self.fixed]
        if len(names) > 4:
            return ", ".join([*names[:4], "…"])
        return enumerated(names)

    def says(self, does: str, *advice: Advice) -> Explanation:
        """``does`` follows the fixed parameter, and whatever changes with it."""
        together = f" together with {self.partners}" if self.partners else ""
        return self.explained(f"{self.fixed}{together} {does}", *advice)

    def explained(self, sentence: str, *advice: Advice) -> Explanation:
        """With what of the advice would tell it; any kind that does, where none of it would."""
        good = [words for words, information in advice if self._told_by(information())]
        # Where the samples are, an open direction may hardly move the tip: that is why it is open.
        direction = self.directions[:, 0] / self.parameter.plausible
        moves = 0.0 if self.motion.vanishes else self.rich.registered(direction)
        if self.redundant:
            to_know = f"; to determine it, {' or '.join(good)}" if good else ""
            needed = (
                "nothing to do if the tip is as in its drawing"
                if moves
                else "nothing to do: this parameter never moves the tip"
            )
            return Explanation(self.fixed, sentence, f"{needed}{to_know}", "redundant", moves)
        if not good:
            several = len(self.problem.arm.arms) > 1 if self.problem.arm else False
            kinds = [
                kind.kind
                for kind in KINDS.values()
                if (several or not kind.between_chains) and self._told_by(self._any(kind))
            ]
            good = [f"add {' or '.join(kinds)}"] if kinds else []
        remedy = " or ".join(good[:3]) or "give it a prior"
        reason: HeldReason = "badly told" if self.spread < self.parameter.plausible else "untold"
        return Explanation(self.fixed, sentence, remedy, reason, moves)

    def kinds(self, gap: Gap) -> list[Advice]:
        """What kinds of observation say that they close the gap."""
        return [
            (kind.tells[gap], partial(self._any, kind))
            for kind in KINDS.values()
            if gap in kind.tells
        ]

    def more(self, words: str) -> Advice:
        """Advice that rich data of the same kinds follow."""
        return words, lambda: self.rich.same

    def oriented(self) -> list[Advice]:
        """To look at the tip's orientation, with each kind that may."""
        return [
            (f"{words} ({kind.kind})", partial(self.rich.tells, kind, True))
            for kind in KINDS.values()
            for words in (
                ["certify the orientation of the seated tip, rotation_rpy_deg"]
                if kind.needs_artefact and kind.has_angles
                else ["measure its orientation too"]
                if kind.columns.orientation == "optional"
                else []
            )
        ]

    def _any(self, kind: type[Term]) -> FloatArray:
        return self.rich.tells(kind, kind.columns.orientation == "required")

    def _told_by(self, information: FloatArray) -> bool:
        """Whether this direction is told, the other open ones being unknown too."""
        values, vectors = np.linalg.eigh(self.directions.T @ information @ self.directions)
        floor = max(1e-12 * float(values[-1]), 1e-12)
        return float(np.sum(vectors[0] ** 2 / np.maximum(values, floor))) < WEAK**2


def redundant_names(explanations: Iterable[Explanation]) -> tuple[str, ...]:
    """Names of the held parameters that no data of these kinds can determine."""
    return tuple(e.fixed for e in explanations if e.reason == "redundant")


def as_drawn_names(explanations: Iterable[Explanation]) -> tuple[str, ...]:
    """Names of those of them that the tip depends on."""
    return tuple(e.fixed for e in explanations if e.as_drawn)


@single_threaded
def explain(
    problem: Problem, x: FloatArray, identification: Identification
) -> tuple[Explanation, ...]:
    """A sentence and a remedy for every undetermined combination at x (n,).

    Each is found by pushing it through the forward kinematics and looking at how the tip moves at
    the samples, with a tolerance for noise.
    """
    arm = problem.names[: problem.arm_count]
    if not any(c.fixed in arm for c in identification.combinations):
        return tuple(_of_term(problem, c) for c in identification.combinations)
    failed = list[str]()
    what = "explained: why parameters are held"
    case_of = attempt(what, lambda: _cases(problem, x, identification), None, failed)
    return tuple(
        _of_arm(c, case_of, failed) if c.fixed in arm else _of_term(problem, c)
        for c in identification.combinations
    )


def _of_arm(
    held: Combination, case_of: Callable[[Combination], _Case] | None, failed: Sequence[str]
) -> Explanation:
    """Why a parameter of the arm is held, or that its explanation failed."""
    fixed, notes = held.fixed, [*failed]
    if case_of is not None:
        explanation = attempt(f"explained: {fixed}", lambda: _explained(case_of(held)), None, notes)
        if explanation is not None:
            return explanation
    sentence = " ".join([f"{fixed} is not determined by these data.", *notes])
    return Explanation(fixed, sentence, "give it a prior", failed=True)


def _explained(case: _Case) -> Explanation:
    rules = (_beside_geometry, _same_thing, _turns_tip, _rigid, _per_placement)
    return next(filter(None, (rule(case) for rule in rules)), None) or _hardly(case)


def _cases(
    problem: Problem, x: FloatArray, identification: Identification
) -> Callable[[Combination], _Case]:
    """What the rules look at, for a combination that holds a parameter of the arm."""
    arm = problem.names[: problem.arm_count]
    rich = RichData(problem, x)
    # In plausible units, per plausible change of the fixed parameter.
    directions = {
        c.fixed: np.array([c.direction.get(n, 0.0) for n in rich.names])
        / rich.unit
        * problem.parameters[c.fixed].plausible
        for c in identification.combinations
        if c.fixed in arm
    }
    redundant = _redundant(rich, directions)
    directions |= redundant
    information = predicted_information(problem, x, problem.assumed_sigmas())
    # How the tip moves, part of very many samples shows as well.
    visited = problem if problem.part is None else problem.part.problem

    def case(c: Combination) -> _Case:
        open_directions = [d for n, d in directions.items() if n != c.fixed and n not in redundant]
        scaled = directions[c.fixed] * rich.unit / problem.parameters[c.fixed].plausible
        direction = {n: float(v) for n, v in zip(rich.names, scaled, strict=True) if v}
        return _Case(
            visited,
            c.fixed,
            tip_motion(visited, x, direction),
            _spread(problem, direction, information),
            rich,
            np.column_stack([directions[c.fixed], *open_directions]),
            c.fixed in redundant,
        )

    return case


def _redundant(rich: RichData, directions: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Of the held parameters, those that stand for what no data of these kinds could tell.

    With the direction of each that is redundant through and through: its own where that is, and
    else what is left of it where other redundant ones stay at nominal.
    """
    held = list(directions)
    rows = [rich.names.index(name) for name in held]
    left, picked = rich.redundant[rows].copy(), list[int]()
    # Part of a direction, relative to the whole, that is rounding.
    rounding = 1e-6
    for _ in range(min(left.shape)):
        size = np.linalg.norm(left, axis=1)
        pick = int(np.argmax(size))
        if size[pick] < rounding:
            break
        picked.append(pick)
        left -= np.outer(left @ left[pick], left[pick]) / size[pick] ** 2
    basis = rich.redundant
    pure = basis @ np.linalg.pinv(basis[[rows[k] for k in picked]])
    answer = {}
    for k, column in zip(picked, pure.T, strict=True):
        mine = directions[held[k]]
        # Noise may be a hundredth of it.
        exact = np.linalg.norm(mine - basis @ (basis.T @ mine)) < 0.01 * np.linalg.norm(mine)
        answer[held[k]] = mine if exact else np.where(np.abs(column) > rounding, column, 0.0)
    return answer


def _of_term(problem: Problem, combination: Combination) -> Explanation:
    """An unknown of a term: where the artefact or the instrument stands."""
    label, fixed = problem.parameters[combination.fixed].owner, combination.fixed
    together = [name for name in combination.direction if name != fixed]
    subject = f"{fixed} together with {', '.join(together)}" if together else fixed
    does = f"changes {label} in a way that its samples hardly show"
    remedy = "to determine it, spread its samples wider"
    if any(
        kind.needs_artefact and label.startswith(f"{kind.place_unknown}[")
        for kind in KINDS.values()
    ):
        does = (
            f"turns the artefact about a line through the landmarks touched at {label}, which "
            "moves none of them"
        )
        remedy = "to determine this pose, touch a landmark off that line"
    reason: HeldReason = "redundant" if problem.arm_count else "untold"
    return Explanation(fixed, f"{subject} {does}", f"nothing to do for the arm; {remedy}", reason)


def _beside_geometry(case: _Case) -> Explanation | None:
    """What is no geometry, and the visited readings do not show."""
    parameter = case.parameter
    if parameter.key == MASS:
        return _mass(case)
    recordings = any(t.poses.samples.travel is not None for t in case.problem.terms)
    if parameter.key in (BACKLASH, HYSTERESIS) and recordings:
        does = f"cannot be determined: {parameter.owner} hardly turns back in these recordings"
        remedy = f"let {parameter.owner} turn back several times within a recording"
        return Explanation(case.fixed, f"{case.fixed} {does}; it looks like an offset", remedy)
    if not case.motion.vanishes or parameter.geometric:
        return None
    columns = {
        BACKLASH: (
            "the samples do not say from which side the joint came",
            f"approach from both sides, and state it in the column {parameter.owner}.direction; or "
            "record the arm in motion, with the column time",
        ),
        HYSTERESIS: (
            "the samples do not say how the joint moved before they were read",
            "record the arm in motion, with the column time",
        ),
        DECAY: (
            f"while {parameter.owner}.hysteresis is zero, nothing depends on it",
            f"nothing to do: it is estimated as soon as {parameter.owner}.hysteresis is not zero",
        ),
        EXPANSION: (
            "the samples do not say when the arm was warm and when it was cold",
            "measure while the arm is warm and while it is cold, and state it in the column "
            "temperature",
        ),
    }
    unknown_gear = (
        "the ratio of the joint's gear is not stated",
        f"state it in the job: arm: {{gear_ratios: {{{parameter.owner}: 100}}}}",
    )
    columns |= dict.fromkeys((*RIPPLE, GEAR_RATIO), unknown_gear)
    # What aliases something else in a recording, or at these readings, is told apart by others.
    if parameter.key in columns and (parameter.key == EXPANSION or not case.partners):
        why, remedy = columns[parameter.key]
        reason: HeldReason = "redundant" if case.redundant else "untold"
        return Explanation(case.fixed, f"{case.fixed} cannot be determined: {why}", remedy, reason)
    if case.partners:
        does = f"has the same effect as {case.partners} at these readings"
        arm = case.problem.arm
        assert arm is not None
        joint = arm.couplings.get(case.fixed, arm.read_from[parameter.owner])
        advice = (f"turn {joint} farther", lambda: case.rich.varied(joint))
        if parameter.key in RIPPLE:
            advice = (f"read {joint} at angles that are no multiple of a ripple apart", advice[1])
        return case.explained(f"{case.fixed} {does}", advice)
    if parameter.key not in (COMPLIANCE, *BENDING):
        return None
    which = "its axis" if parameter.key == COMPLIANCE else "this axis across its own"
    does = f"has no effect in these postures: gravity has no torque about {which}"
    return case.explained(f"{case.fixed} {does}", case.more("tilt its axis"))


def _mass(case: _Case) -> Explanation:
    """A mass moves the tip only where a joint yields, and only by its product with a compliance."""
    if not case.partners:
        does = "has hardly any effect: in these postures gravity has little torque at it about an "
        return Explanation(case.fixed, f"{case.fixed} {does}axis that yields", "give it a prior")
    parameters = case.problem.parameters
    yielding = any(parameters[n].key in (COMPLIANCE, *BENDING) for n in case.motion.main)
    why = (
        "a greater mass and a smaller compliance deflect the arm alike, so that the data show only "
        "their product"
        if yielding
        else "a greater mass and a smaller one beside it deflect the arm alike"
    )
    remedy = "give a mass a prior" + (
        ", or measure with several known loads at the tip, and state them in the column payload_kg"
        if yielding
        else ""
    )
    sentence = f"{case.fixed} together with {case.partners} has hardly any effect: {why}"
    return Explanation(case.fixed, sentence, remedy)


def _same_thing(case: _Case) -> Explanation | None:
    if not case.motion.vanishes:
        return None
    keys = {case.problem.parameters[name].key for name in case.motion.main}
    if keys <= set(POSITION):
        does = "has the same effect as {others}: together they slide a joint's frame along its axis"
    elif not keys & set(POSITION):
        does = "has the same effect as {others}: together they turn a joint's frame about its axis"
    else:
        does = "cancels {others}: together they move a joint's frame, not the tip"
    return case.explained(
        f"{case.fixed} {does.format(others=case.partners or 'another parameter')}"
    )


def _turns_tip(case: _Case) -> Explanation | None:
    if not case.motion.turns_in_place:
        return None
    why = "no observation measures the tip's orientation"
    if any(block.unit == "rad" for block in case.problem.blocks):
        why = "other unknowns of the observations can cancel it"
    return case.says(f"turns the tip without moving it, and {why}", *case.oriented())


def _rigid(case: _Case) -> Explanation | None:
    """One rigid motion for all samples: of the whole arm in the base, or of the tip in the tool."""
    v_base, w_base, base_misfit = case.motion.base_twist()
    v_tool, w_tool, tool_misfit = case.motion.tool_twist()
    in_base, in_tool = base_misfit < NOISE, tool_misfit < NOISE
    # With a tool that never tilts both fit: then the parameters' place in the chain decides.
    if in_base and in_tool:
        assert case.problem.arm is not None
        main = case.motion.main
        first = case.problem.arm.segments[0].owner
        strongest = case.problem.parameters[main[0]].owner if main else first
        orders = [[s.owner for s in arm.segments] for arm in case.problem.arm.arms]
        order = next(order for order in orders if strongest in order)
        in_base = order.index(strongest) < 0.5 * max(len(order) - 1, 1)
        in_tool = not in_base
    terms = case.problem.terms
    if in_base:
        why = next((t.opens["base"][0] for t in terms if "base" in t.opens), "")
        turning = float(np.linalg.norm(w_base)) * LEVER > NOISE * case.motion.size
        does = (
            f"turns the whole arm about the base's {_axis(w_base)}"
            if turning
            else f"shifts the whole arm along the base's {_axis(v_base)}"
        )
        gauge = (
            "measurements relative to an artefact or a point of unknown place cannot show where "
            "the arm stands"
        )
        return case.says(f"{does}: {why or gauge}", *case.kinds("base"))
    if not in_tool:
        return None
    if all("tool" in term.opens for term in terms):
        does = terms[0].opens["tool"][0]
        return case.says(does, *case.kinds("tool"), *case.oriented())
    if float(np.linalg.norm(w_tool)) * LEVER <= NOISE * case.motion.size:
        return case.says(
            f"changes the tool's length along the tip's {_axis(v_tool)}: this cancels in every "
            "distance because the tool always has the same direction relative to the artefact",
            *case.kinds("tool"),
            case.more("tilt the tool against the artefact"),
        )
    return case.says(
        f"redefines the tip frame (a turn about the tip's {_axis(w_tool)}), and every observation "
        "fits as well as before",
        *case.oriented(),
        case.more("tilt the tool in more directions"),
    )


def _per_placement(case: _Case) -> Explanation | None:
    if case.motion.rigid_per_group(placement_groups(case.problem)) > NOISE:
        return None
    return case.says(
        "moves all points touched at one place together, and the unknown pose of that place "
        "cancels it",
        case.more("touch points farther apart within each placement"),
        *case.kinds("place"),
    )


def _hardly(case: _Case) -> Explanation:
    parameter = case.parameter
    plausible = _amount(parameter.plausible, parameter.unit)
    would = (
        f"predicted ±{_amount(case.spread, parameter.unit)}, but ±{plausible} is known beforehand"
        if math.isfinite(case.spread)
        else f"it may be off by ±{plausible}, and no measured value changes"
    )
    assert case.problem.arm is not None
    # The moving joint whose excitation would tell: the last one at or before the parameter.
    arm, joint = case.problem.arm, ""
    for segment in arm.segments:
        joint = arm.read_from.get(segment.owner, joint)
        if segment.owner == parameter.owner and joint:
            break
    else:
        joint = arm.joints[0]
    return case.says(
        f"hardly changes any measured value in these postures ({would})",
        (f"measure in postures that differ more in {joint}", lambda: case.rich.varied(joint)),
        case.more("measure all over the range of every joint"),
    )


def _spread(problem: Problem, direction: Mapping[str, float], information: Information) -> float:
    """Predicted standard deviation along a direction, in the fixed parameter's unit."""
    free = [k for k, p in enumerate(problem.parameters.values()) if p.free]
    own_unknowns = [k for k in free if k >= problem.arm_count]
    d = np.array([direction.get(name, 0.0) for name in problem.names])
    curvature = information.curvature
    pushed = curvature @ d
    squared = float(d @ pushed)
    if own_unknowns:
        prior = np.diag(problem.prior_precision()[own_unknowns])
        inverse = np.linalg.pinv(curvature[np.ix_(own_unknowns, own_unknowns)] + prior, 1e-11, True)
        squared -= float(pushed[own_unknowns] @ inverse @ pushed[own_unknowns])
    # Below the rounding of its sum it has no meaning.
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
    written: dict[Unit, str] = {"m": " mm", "rad": "°", "rad/Nm": "°/Nm", "kg": " kg"}
    written["1/K"] = " ppm/K"
    return number + written.get(unit, "")
