"""What may have changed since a calibration, each with the columns of the Jacobian that it moves.

Almost all of it is a group of parameters of the new rows' problem: the pose of a camera or an
instrument, the placement of a link, the zero of a joint. What a kind of another package has for its
own unknowns is such a group too. What no parameter describes (the scale, what a camera is taken to
be, a hypothesis of the registry with `Hypothesis.checked_as`) brings its columns.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.check.new_rows import NewRows
from suta_calib.display import Displayable
from suta_calib.geometry.lens import FOCAL
from suta_calib.geometry.numbers import vector_from_rotation
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import OFFSET, PLACEMENT, Parameter
from suta_calib.model.robot import Robot
from suta_calib.terms.external_frame import ExternalFrame
from suta_calib.terms.length_scale import lengthened, scale_carrier, scale_carriers
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import Effect, Evidence
from suta_calib.trust.examination import STEP
from suta_calib.trust.hypothesis import AddedVariable, known_hypotheses
from suta_calib.units import Unit

# What a frame is called that is no place where something stands.
_WORDS: Final = {"eye": "camera", "target": "board", "base": "instrument"}
_PLACEMENT: Final = "placement"
# Changes that may have happened and be found in full, by unit: nobody overlooks larger ones.
PLAUSIBLE: Final[dict[Unit, float]] = {"m": 0.05, "rad": 0.1, "1": 0.05, "px": 50.0}


@dataclass(frozen=True, eq=False)
class Suspect(Displayable):
    """Something that may have changed.

    Attributes:
        what: in a word, and which one where there are several.
        columns: (m, k) change of the whitened rows.
        units: of each of the k numbers.
        names: parameters of the new rows' problem that describe it; empty where none do.
        motion: (6, k) by how much it is moved, m, and turned, rad; None of what is no pose.
        largest: (k,) how large it may be, where that is not as of its units.
    """

    what: str
    columns: FloatArray
    units: tuple[Unit, ...]
    names: tuple[str, ...] = ()
    motion: FloatArray | None = None
    largest: FloatArray | None = None

    @property
    def effect(self) -> Effect:
        """To be tested."""
        plausible = self.largest
        if plausible is None:
            plausible = np.array([PLAUSIBLE.get(unit, 1.0) for unit in self.units])
        return Effect(self.what, self.columns, plausible, parameters=self.names, about=self)

    def amounts(
        self, size: FloatArray, covariance: FloatArray
    ) -> Mapping[Unit, tuple[float, float]]:
        """By how much it changed, and the standard deviation of that, by unit."""
        if self.motion is not None:
            size, covariance = self.motion @ size, self.motion @ covariance @ self.motion.T
        answer = dict[Unit, tuple[float, float]]()
        for unit, part in self.parts:
            vector, spread = size[part], covariance[np.ix_(part, part)]
            if not spread.any():
                continue  # The rows do not look at it.
            length = float(np.linalg.norm(vector))
            along = vector / max(length, 1e-300)
            amount = float(vector[0]) if len(vector) == 1 else length
            answer[unit] = amount, math.sqrt(max(float(along @ spread @ along), 0.0))
        return answer

    @property
    def parts(self) -> list[tuple[Unit, list[int]]]:
        """Components of a change (of its motion, where it is one) of one unit each."""
        units = self.units
        if self.motion is not None:
            units = ("m", "m", "m", "rad", "rad", "rad")
        moved = [True] * len(units) if self.motion is None else np.any(self.motion, axis=1).tolist()
        return [
            (unit, [k for k, u in enumerate(units) if u == unit and moved[k]])
            for unit in dict.fromkeys(units)
            if any(moved[k] for k, u in enumerate(units) if u == unit)
        ]


def suspects_of(rows: NewRows, known: Container[str]) -> list[Suspect]:
    """Everything that may have changed, and that the rows look at: of `candidates_of`."""
    return [suspect for suspect in candidates_of(rows, known) if np.any(suspect.columns)]


def candidates_of(rows: NewRows, known: Container[str]) -> list[Suspect]:
    """Everything that may have changed, whether or not the rows look at it.

    Args:
        rows: new ones.
        known: names that the calibration has a value of.
    """
    found = [*_joints(rows), *_frames(rows, known), *_own(rows, known), *_links(rows)]
    return [*found, *_scales(rows), *_assumed(rows), *_registered(rows)]


def _group(rows: NewRows, what: str, names: Sequence[str], motion: FloatArray | None) -> Suspect:
    problem = rows.problem
    at = [problem.names.index(name) for name in names]
    units = tuple(problem.parameters[name].unit for name in names)
    return Suspect(what, rows.jacobian[:, at], units, tuple(names), motion)


def _joints(rows: NewRows) -> Iterator[Suspect]:
    """Zeros: of one joint, and of all, as of another day."""
    offsets = [p for p in rows.problem.arm_parameters.values() if p.key == OFFSET]
    for p in offsets:
        yield _group(rows, f"joint {p.owner}", [p.name], None)
    if len(offsets) > 1:
        yield _group(rows, "zeros of all joints", [p.name for p in offsets], None)


def _frames(rows: NewRows, known: Container[str]) -> Iterator[Suspect]:
    """Cameras, boards, instruments, and what was put down somewhere."""
    of_frame = {
        frame.owner: (frame, term)
        for term in rows.problem.terms
        for frame in term.outside
        if all(name in known for name in frame.names)
    }
    called = {owner: _called(frame, term) for owner, (frame, term) in of_frame.items()}
    for owner, (frame, term) in of_frame.items():
        label = owner[owner.find("[") + 1 : -1] if "[" in owner else ""
        several = sum(word == called[owner] for word in called.values()) > 1
        what = f"{called[owner]} {label}" if label and several else called[owner]
        # Of what sees an arm from afar, a turn is one about the middle of the tips.
        point = rows.tips_of(term).mean(axis=0) if frame.what == "base" else np.zeros(3)
        yield _group(rows, what, frame.names, _moved(frame, rows.values, point))


def _called(frame: ExternalFrame, term: Term) -> str:
    if frame.what == term.place:
        return _PLACEMENT
    return _WORDS.get(frame.what, frame.what)


def _moved(frame: ExternalFrame, values: Mapping[str, float], point: FloatArray) -> FloatArray:
    """(6, k) displacement of a point of a frame, and its turn, by each of its unknowns."""
    columns = np.zeros((6, len(frame.names)))
    for k, name in enumerate(frame.names):
        (Ra, pa), (Rb, pb) = (
            frame.pose({**values, name: values[name] + step}) for step in (-STEP, STEP)
        )
        if Ra is None or Rb is None:
            columns[:3, k] = (pb - pa) / (2.0 * STEP)
            continue
        columns[:3, k] = (Rb @ point + pb - Ra @ point - pa) / (2.0 * STEP)
        columns[3:, k] = vector_from_rotation(Rb @ Ra.T) / (2.0 * STEP)
    return columns


def _own(rows: NewRows, known: Container[str]) -> Iterator[Suspect]:
    """What else the terms have for unknowns and the calibration told: a radius, intrinsics."""
    frames = {name for term in rows.problem.terms for f in term.outside for name in f.names}
    own = [*rows.problem.parameters.values()][rows.problem.arm_count :]
    by_owner = dict[str, list[Parameter]]()
    cameras = {p.owner for p in own if p.unit == "px"}
    for p in own:
        if p.name in known and p.name not in frames:
            by_owner.setdefault(_intrinsics(p, cameras) or p.owner, []).append(p)
    for owner, group in by_owner.items():
        yield _group(rows, owner, [p.name for p in group], None)


def _intrinsics(parameter: Parameter, owners: Container[str]) -> str:
    """What a camera's intrinsics are called; empty of what are none."""
    if parameter.key in FOCAL and parameter.unit == "px":
        return "focal length"
    return "lens and principal point" if parameter.owner in owners else ""


def _links(rows: NewRows) -> Iterator[Suspect]:
    """Base, tip, and each link between two joints, of every chain."""
    arm = rows.problem.arm
    if not isinstance(arm, ArmModel | Robot):
        return
    several, said = len(arm.arms) > 1, set[str]()
    for chain, called in zip(arm.arms, getattr(arm, "chains", {"": None}), strict=False):
        of = f" of chain {called}" if several else ""
        owners = dict.fromkeys(p.owner for p in chain.parameters.values())
        for k, owner in enumerate(owners):
            names = [f"{owner}.{key}" for key in PLACEMENT]
            if owner in said or not all(name in rows.problem.parameters for name in names):
                continue
            said.add(owner)
            if owner == chain.tip:
                yield _group(rows, f"tip{of}", names, np.eye(6))
            elif k == 0:
                # The whole arm, as its tips move.
                at = [rows.problem.names.index(name) for name in names]
                moved = rows.table.velocity[:, at].reshape(-1, 6, 6).mean(axis=0)
                yield _group(rows, f"base{of}", names, moved)
            else:
                yield _group(rows, f"link {owner}", names, np.eye(6))


def _scales(rows: NewRows) -> Iterator[Suspect]:
    """A common factor on all lengths of an instrument, an artefact or a board."""
    terms = rows.problem.terms
    carriers = scale_carriers(terms)
    for carrier in carriers:
        longer = [
            lengthened(term, 1.0 + STEP)
            if (mine := scale_carrier(term))
            and (mine.what, mine.name) == (carrier.what, carrier.name)
            else term
            for term in terms
        ]
        of = f" of the {carrier.what} {carrier.name}" if len(carriers) > 1 else ""
        yield Suspect(f"scale{of}", rows.shared.combine(rows.by_terms(longer)), ("1",))


def _assumed(rows: NewRows) -> Iterator[Suspect]:
    """What a term takes for certain, such as the focal lengths of a camera."""
    for k, term in enumerate(rows.problem.terms):
        estimated = term.with_assumptions_estimated
        if estimated is None:
            continue
        terms = [estimated if j == k else t for j, t in enumerate(rows.problem.terms)]
        more = rows.with_terms(terms)
        mine = {p.name for p in term.own_parameters}
        groups = dict[str, list[str]]()
        for p in estimated.own_parameters:
            if p.name not in mine:
                groups.setdefault(_intrinsics(p, ()) or p.owner, []).append(p.name)
        for owner, names in groups.items():
            at = [more.problem.names.index(name) for name in names]
            units = tuple(more.problem.parameters[name].unit for name in names)
            if owner == "focal length":
                yield Suspect(owner, more.jacobian[:, at], units)


def _registered(rows: NewRows) -> Iterator[Suspect]:
    """Hypotheses that say what a check calls them."""
    for hypothesis in known_hypotheses().values():
        if not hypothesis.checked_as or not hypothesis.applies(rows.problem):
            continue
        assert isinstance(hypothesis, AddedVariable)
        for effect in hypothesis.effects(rows):
            what = f"{hypothesis.checked_as} {effect.name}"
            columns = rows.shared.combine(effect.columns)
            yield Suspect(what, columns, ("1",) * columns.shape[1], largest=effect.plausible)


def suspect_of(evidence: Evidence) -> Suspect:
    """Whose evidence it is."""
    suspect: Suspect = evidence.effect.about
    return suspect
