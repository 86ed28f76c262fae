"""A calibration in space: the arm, what was touched or seen, and how far off the tip was and is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import PLACEMENT, POSITION
from suta_calib.model.robot import AnyArm
from suta_calib.plotting.look import MOST_LABELLED
from suta_calib.plotting.scene import (
    Arrows,
    Line,
    Part,
    PlacedPoints,
    Scene,
    drawn_rows,
    largest_of_regions,
    magnification,
)
from suta_calib.terms.poses import ArmPoses
from suta_calib.terms.term import Term
from suta_calib.trust.tip import tip_displacements


def calibration_scene(
    arm: AnyArm, terms: Sequence[Term], before: Mapping[str, float], after: Mapping[str, float]
) -> Scene:
    """The arm at its first sample, the places of all samples, and errors before and after.

    By the values of all parameters. Errors are arrows from where the tip should have been to where
    the arm says it is, all magnified alike. Of a robot, chains that begin in its base are drawn:
    what one hand sees of the other has no place in a picture in which both move.
    """
    first = arm.arms[0].chain.base
    chains = [chain for chain in arm.arms if chain.chain.base == first]
    terms = [term for term in terms if _chain_of(term) in (None, *chains)] or terms
    drawn = list[Scene]()
    for chain in chains:
        of_chain = [term for term in terms if _chain_of(term) is chain]
        drawn += [chain.scene(t.poses.samples.q[0]) for t in (of_chain or terms)[:1]]
    scene = _together(drawn)
    errors = [_errors(terms, values) for values in (before, after)]
    size = float(np.ptp(scene.extent, axis=0).max())
    factor = magnification(errors[0][1], size)
    touched = all(term.medium == "touch" for term in terms)
    word = "touched places of the tip" if touched else "measured places of the tip"
    parts: list[Part] = [PlacedPoints(word, "touched", errors[1][0])]
    rows = largest_of_regions(errors[1][0], np.linalg.norm(errors[1][1], axis=1))
    count = len(errors[1][0])
    few = (
        f" ({len(rows)} of {count:,}: the largest error in each region)"
        if len(rows) < count
        else ""
    )
    before_at, after_at = ((at[rows], off[rows]) for at, off in errors)
    parts.append(Arrows("error before", "before", *before_at, factor))
    parts.append(Arrows(f"error after{few}", "after", *after_at, factor))
    for what, places in _places(terms, after).items():
        labels = tuple(places) if len(places) <= MOST_LABELLED else ()
        parts.append(PlacedPoints(what, "place", np.array(list(places.values())), labels))
    return scene + Scene(tuple(parts))


def _chain_of(term: Term) -> ArmModel | None:
    return term.poses.arm if isinstance(term.poses, ArmPoses) else None


def _together(scenes: Sequence[Scene]) -> Scene:
    """Chains as one robot: a line of each, which what is not a number interrupts."""
    parts = list[Part]()
    for part, *rest in zip(*(scene.parts for scene in scenes), strict=True):
        gap = [np.full((1, 3), np.nan)] if isinstance(part, Line) else []
        points = [part.points, *(p for other in rest for p in (*gap, other.points))]
        parts.append(replace(part, points=np.concatenate(points)))
    return Scene(tuple(parts))


def _places(terms: Sequence[Term], values: Mapping[str, float]) -> dict[str, dict[str, FloatArray]]:
    """Positions (3,) of what stands in the base, by what it is and by its label, m.

    Where not all of a position is known, as of a plane, it is amid what was touched there.
    """
    places: dict[str, dict[str, FloatArray]] = {}
    for term in terms:
        labels_shown = set()
        for frame in term.outside:
            has_pose = frame.keys in (PLACEMENT, POSITION) and set(frame.names) <= values.keys()
            if frame.within == "base" and has_pose:
                label = frame.owner.partition("[")[2].rstrip("]")
                places.setdefault(frame.what, {})[label] = frame.pose(values)[1]
                labels_shown.add(label)
        if term.medium == "touch" and term.place:
            names, which = term.places
            target = term.observed(values, term.poses).place
            rows = np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which))[:-1])
            rest = {
                name: np.median(target[own_rows], axis=0)
                for name, own_rows in zip(names, rows, strict=True)
                if name not in labels_shown
            }
            if rest:
                places.setdefault(term.place, {}).update(rest)
    return places


def _errors(terms: Sequence[Term], values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """`tip_displacements` of all terms, of as many samples as are drawn."""
    rows = drawn_rows(sum(len(term.poses) for term in terms))
    errors = []
    for term in terms:
        # What is touched is found from all touches of it; what is seen is seen sample by sample.
        chosen = np.arange(len(term.poses))[rows]
        if term.medium == "touch":
            target, off = tip_displacements(term, values)
            errors.append((target[chosen], off[chosen]))
        else:
            errors.append(tip_displacements(term.take(chosen), values))
    targets, displacements = zip(*errors, strict=True)
    return np.concatenate(targets), np.concatenate(displacements)
