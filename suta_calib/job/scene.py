"""A calibration in space: the arm, what was touched or seen, and how far off the tip was and is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.diagnostics.displacements import tip_displacements
from suta_calib.model.arm import ArmModel
from suta_calib.plotting.scene import (
    Arrows,
    Part,
    Points,
    Scene,
    drawn_rows,
    magnification,
)
from suta_calib.terms.term import Term


def calibration_scene(
    arm: ArmModel,
    terms: Sequence[Term],
    before: Mapping[str, float],
    after: Mapping[str, float],
) -> Scene:
    """The arm at its first sample, the places of all samples, and errors before and after.

    Args:
        arm: at nominal.
        terms: of the arm, at least one.
        before: values of all parameters with the nominal arm.
        after: the same with the calibrated arm.

    Returns:
        Places, and errors as arrows from where the tip should have been to where the arm says it
        is, all magnified alike.
    """
    first = terms[0].poses.samples.q[0]
    scene = arm.scene(first)
    errors = [_errors(terms, values) for values in (before, after)]
    size = float(np.ptp(scene.extent, axis=0).max())
    factor = magnification(errors[0][1], size)
    touched = all(term.medium == "touch" for term in terms)
    word = "where the tip touched" if touched else "where the tip was seen"
    parts: list[Part] = [Points(word, "touched", errors[1][0])]
    parts.append(Arrows("error before", "before", *errors[0], factor))
    parts.append(Arrows("error after", "after", *errors[1], factor))
    frames = {frame.owner: frame for term in terms for frame in term.outside}
    standing: dict[str, dict[str, FloatArray]] = {}
    for owner, frame in frames.items():
        if frame.within == "base" and set(frame.names) <= after.keys():
            label = owner.partition("[")[2].rstrip("]")
            standing.setdefault(frame.what, {})[label] = frame.pose(after)[1]
    for what, places in standing.items():
        parts.append(Points(what, "place", np.array(list(places.values())), tuple(places)))
    return scene + Scene(tuple(parts))


def _errors(terms: Sequence[Term], values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """`tip_displacements` of all terms, of as many samples as are drawn."""
    rows = drawn_rows(sum(len(term.poses) for term in terms))
    found = []
    for term in terms:
        # What is touched is found from all touches of it; what is seen is seen sample by sample.
        some = np.arange(len(term.poses))[rows]
        if term.medium == "touch":
            target, off = tip_displacements(term, values)
            found.append((target[some], off[some]))
        else:
            found.append(tip_displacements(term.take(some), values))
    targets, displacements = zip(*found, strict=True)
    return np.concatenate(targets), np.concatenate(displacements)
