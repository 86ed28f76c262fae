"""How much the samples so far determine, and where to measure next."""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from suta_calib.analysis import planning
from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rpy_from_rotation
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.standing_elsewhere import job_so_far
from suta_calib.units import Unit, deg, from_mm, mm, std_text

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Determined:
    """One parameter that moves the tip.

    Attributes:
        name: of the parameter.
        std: its standard uncertainty, m or rad, with its bounds as prior knowledge.
        tip: how far the tip moves by that, RMS in the region after registration, m.
        share: how much of it is determined, from 0 to 1; on a scale of ratios.
    """

    name: str
    unit: Unit
    std: float
    tip: float
    share: float

    @property
    def words(self) -> str:
        """Its uncertainty with its unit."""
        return f"± {std_text(self.std, self.unit)}"


@dataclass(frozen=True, eq=False)
class SoFar:
    """What the samples so far determine.

    Attributes:
        parameters: those that move the tip.
        tip: RMS uncertainty of the tip in the region, m.
        worst: that at the worst place, m.
        worst_at: (3,) where that is, base frame, m.
        samples: how many rows tell it.
    """

    parameters: tuple[Determined, ...]
    tip: float
    worst: float
    worst_at: FloatArray
    samples: int


@dataclass(frozen=True, eq=False)
class NextPlace:
    """The measurement that would tell most.

    Attributes:
        sort: of place, as a column of samples has it: ``placement``, ``point``; empty of postures.
        what: where it is, in words.
        why: what it brings.
        enough: whether it brings next to nothing.
        count: of touches, where it has no landmarks; else 0.
        landmarks: (n, 3) where the artefact would have its landmarks, or the point, m.
        position, rotation: of the artefact, or the point, or the tip, in the base.
        readings: (joints,) of a posture in which it is measured, or first touched, rad or m.
    """

    sort: str
    what: str
    why: str
    enough: bool
    count: int
    landmarks: FloatArray
    position: FloatArray
    rotation: FloatArray
    readings: FloatArray


def determined(job: Path) -> SoFar | None:
    """What the samples that a job has now determine; None where they are too few to say.

    Linearised at the nominal arm, with the noise that the job states: as quick as a landmark is
    changed.

    Raises:
        InputError: the job cannot be used.
    """
    return _of_rows_measured(job, _determined)


def next_place(job: Path) -> NextPlace | None:
    """What to measure next by the samples that a job has now; None where they are too few.

    Raises:
        InputError: the job cannot be used, or the arm reaches none of the places.
    """
    return _of_rows_measured(job, _next_place)


def next_posture(job: Path) -> NextPlace | None:
    """The posture to rest in next; as `next_place`.

    Raises:
        InputError: the job cannot be used.
    """
    return _of_rows_measured(job, lambda loaded: _next_place(loaded, touching=False))


def _of_rows_measured(job: Path, answer: Callable[[CalibrationJob], Answer]) -> Answer | None:
    with (
        tempfile.TemporaryDirectory(prefix="suta_calib-guide-") as folder,
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        reduced = job_so_far(job, Path(folder) / job.name)
        return None if reduced is None else answer(CalibrationJob.load(reduced))


def _determined(job: CalibrationJob) -> SoFar:
    situation = planning.Situation.of(job.problem())
    space = planning.SharedUnknowns.of(situation)
    count = space.arm_count
    covariance = space.plausible_covariance(planning.present_information(situation, space))
    covariance = covariance[:count, :count]
    tip = planning.Region.around(situation).sensitivity(situation, space.names[:count], 0)
    std = np.sqrt(np.diag(covariance))
    parameters = []
    for k, parameter in enumerate(list(space.parameters.values())[:count]):
        # At first and now, of the tip, m.
        before, now = (tip.moved(size * np.eye(count)[k]) for size in (parameter.plausible, std[k]))
        if before <= 0:
            continue  # It only says where the base is.
        gained = math.log(max(before / now, 1.0)) if now > 0 else math.inf
        # A parameter is determined where what is left of it moves the tip by no more than a plug
        # that is seated by hand scatters, m.
        needed = math.log(max(before / from_mm(0.1), 1.0))
        share = 1.0 if gained >= needed else gained / needed
        parameters.append(Determined(parameter.name, parameter.unit, float(std[k]), now, share))
    uncertain = tip.std(covariance, tip.registered())
    worst = int(np.argmax(uncertain))
    rms = float(np.sqrt(np.mean(uncertain**2)))
    return SoFar(
        tuple(parameters), rms, float(uncertain[worst]), tip.position[worst], situation.samples
    )


def _next_place(job: CalibrationJob, *, touching: bool = True) -> NextPlace:
    situation = planning.situation_of_job(job)
    # Enough to find a good one while somebody puts the artefact down, or moves the arm.
    pool = planning.Pool(placements=0, points=0, poses=60)
    if touching:
        pool = planning.Pool(placements=120, points=40, poses=0)
    plan = planning.plan(situation, planning.PlanOptions(count=1, pool=pool))
    candidate, stop = plan.chosen[0].candidate, plan.stop
    place, sort, count = candidate.place, "", 0
    rotation, position = situation.arm.forward(candidate.q[0], situation.values)
    if not isinstance(place, planning.Posture):
        rotation, position = np.eye(3), place.position
    landmarks, where = position[None], "x = {:.0f}, y = {:.0f}, z = {:.0f} mm".format(*mm(position))
    if isinstance(place, planning.Placement):
        assert situation.artefact is not None
        sort, rotation = "placement", place.rotation
        names = list(situation.artefact.landmarks)
        landmarks = situation.artefact.position_of(names) @ rotation.T + position
        what = f"the artefact at {where}, turned by {deg(rpy_from_rotation(rotation)[2]):.0f}°"
        what += f", tilted by {deg(place.tilt):.0f}°" if deg(place.tilt) >= 1 else ""
    elif isinstance(place, planning.Posture):
        what = f"the posture with the tip at {where}"
    else:
        sort, count = place.kind, place.directions
        what = f"one {sort} at {where}, touched from {count} directions"
    enough = stop.worthwhile == 0
    why = f"The tip is then known to ± {std_text(stop.tips[1], 'm')}."
    if enough:
        why = f"Even {what} would make the ± of the tip smaller by less than "
        why += f"{100 * stop.least_gain:.0f} %."
    return NextPlace(
        *(sort, what, why, enough, count, landmarks, position, rotation, candidate.q[0])
    )
