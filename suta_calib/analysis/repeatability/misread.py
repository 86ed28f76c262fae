"""Visits of which one joint's column was misread: the tip scatters as if the joints were strangers.

An arm that comes back to a point from several sides moves every joint, and what one does to the tip
the others undo. Where a joint counts the other way or in another unit than the others, or two
columns are exchanged, they do not, and the scatter is that of joints which have nothing to do with
each other. So it is of an arm that comes back in one and the same posture, where only noise moves
the joints: there no reading of the columns makes them undo each other, and none is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from suta_calib.analysis.repeatability.scatter import deviations, tip_levers
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements import Samples
from suta_calib.model.arm import ArmModel
from suta_calib.trust.hypothesis import known_hypotheses
from suta_calib.trust.sample_readings import MisreadJoints
from suta_calib.units import Unit, from_deg, from_mm, mm

# Visits that are enough for no reading to fit by chance, and ways in which the joints must have
# moved for it: between two points they move in one way, which some reading undoes.
ENOUGH: Final = 8
WAYS: Final = 2
# Units in which a single column may be, beside those it should be in, and how much one of them is.
UNITS: Final[dict[Unit, dict[str, float]]] = {
    "rad": {"degrees": from_deg(1.0), "turns": 2 * np.pi},
    "m": {"mm": from_mm(1.0)},
}


def misread(arm: ArmModel, samples: Samples, position: FloatArray) -> str | None:
    """What would have to be so of the joints' columns for the visits to be of one point.

    Args:
        arm: whose readings these are.
        samples: the visits.
        position: (n, 3) of the tip at each, m.

    Returns:
        A sentence, or None where the joints undo each other as they are, or in no reading.
    """
    # A reading with so many times less scatter, in either measure, is what the columns are.
    far_better = 3.0
    # Scatter, m, below which the joints did not move.
    still = 1e-9
    if len(samples) < ENOUGH:
        return None
    ways = _ways(arm, samples.q)
    as_read = _scatter(position), float(np.linalg.norm(ways))
    # Scatter of the tip, in units of that of unrelated joints, below which they undo each other.
    if len(ways) < WAYS or as_read[1] < still or as_read[0] <= 0.25 * as_read[1]:
        return None
    explanations = list[tuple[float, str]]()
    for sentence, change in _readings(arm):
        q = change(samples).q
        tip, moved = _scatter(arm.forward(q)[1]), _ways(arm, q)
        unrelated = max(float(np.linalg.norm(moved)), still)
        # By how much levers are shorter in other postures says nothing.
        undone = tip / unrelated * far_better < as_read[0] / as_read[1]
        if undone and tip * far_better < moved[WAYS - 1]:
            explanations.append((tip, sentence))
    tip, sentence = min(explanations, default=(np.inf, ""))
    if tip * far_better > as_read[0]:
        return None
    return (
        f"The visits scatter by {mm(tip):.3f} mm (RMS), not by {mm(as_read[0]):.3f} mm, if "
        f"{sentence}: as they are, the readings are not this arm's at one point."
    )


def _readings(arm: ArmModel) -> Iterator[tuple[str, Callable[[Samples], Samples]]]:
    """Other readings of the columns, each with what would have to be so."""
    joints = [h for h in known_hypotheses().values() if isinstance(h, MisreadJoints)]
    for hypothesis in sorted(joints, key=lambda h: h.precedence):
        yield from hypothesis.of_arm(arm)
    for k, (name, unit) in enumerate(arm.units.items()):
        for other, factor in UNITS.get(unit, {}).items():
            yield f"the readings of {name} are in {other}, not {unit}", partial(_times, k, factor)
        yield f"the readings of {name} are one row late", partial(_slid, k, -1)
        yield f"the readings of {name} are one row early", partial(_slid, k, 1)


def _times(column: int, factor: float, samples: Samples) -> Samples:
    """The samples with one joint's readings in another unit."""
    q = samples.q.copy()
    q[:, column] *= factor
    return replace(samples, q=q)


def _slid(column: int, rows: int, samples: Samples) -> Samples:
    """The samples with one joint's readings some rows later, without those that have none."""
    q = samples.q.copy()
    q[:, column] = np.roll(q[:, column], rows)
    rows_used = np.arange(1, len(q)) if rows > 0 else np.arange(len(q) - 1)
    return replace(samples, q=q).take(rows_used)


def _scatter(position: FloatArray) -> float:
    return rms_length(position - position.mean(axis=0))


def _ways(arm: ArmModel, q: FloatArray) -> FloatArray:
    """By what the joints move the tip, each for itself, RMS, m: along its principal axes."""
    units = arm.units.values()
    off = np.stack(
        [deviations(readings, unit)[1] for readings, unit in zip(q.T, units, strict=True)], 1
    )
    off -= off.mean(axis=0)
    return np.asarray(np.linalg.svd(off * tip_levers(arm, q), compute_uv=False) / np.sqrt(len(q)))
