"""Simulated SUTA data with one landmark that is not where its certificate says."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from suta_calib.analysis.outliers import Outliers, find_outliers
from suta_calib.arrays import FloatArray
from suta_calib.job.calibration import CalibrationJob
from suta_calib.measurements import Artefact, Samples, read_artefact, write_artefact
from suta_calib.simulation import Simulation, SimulationSpec, read_simulation, simulate
from suta_calib.solver.problem import Problem
from suta_calib.terms import ArmPoses, Noise, PairwiseDistance

SUTA = Path(__file__).resolve().parents[2] / "data" / "suta"
Kind = Literal["touches", "certificate"]
NOISE = Noise(None, 1.35e-3)


@cache
def suta_job() -> CalibrationJob:
    return CalibrationJob.load(SUTA / "calibration.yaml")


@cache
def description() -> SimulationSpec:
    spec = read_simulation(SUTA / "simulation.yaml")
    return replace(spec, sets=tuple(s for s in spec.sets if s.artefact is not None))


def moved(artefact: Artefact, shifts: dict[str, FloatArray]) -> Artefact:
    """The artefact with some landmarks elsewhere, m."""
    marks = dict(artefact.landmarks)
    for name, shift in shifts.items():
        marks[name] = replace(marks[name], position=marks[name].position + shift)
    return Artefact(artefact.name, marks)


@dataclass(frozen=True, eq=False)
class Study:
    """One simulated calibration of the SUTA, with its validation."""

    calibration: PairwiseDistance
    validation: PairwiseDistance
    gross: int

    def outliers(self, *sorts: str) -> Outliers:
        """Of the sorts of groups named, or of all."""
        problem = Problem([self.calibration], suta_job().parameters)
        return find_outliers(problem, [self.validation], sorts=sorts or None)


def suta_study(seed: int, shifts: dict[str, FloatArray], kind: Kind = "certificate") -> Study:
    """Simulate ``data/suta`` with a seed of its own.

    Args:
        seed: of everything that is drawn.
        shifts: by landmark, how far it lies (``touches``) or is certified (``certificate``) from
            where it should be, m.
        kind: whether the landmark of the calibration's artefact was displaced when it was touched,
            or the file says a wrong position.
    """
    certified = read_artefact(SUTA / "artefact.yaml")
    wrong = moved(certified, shifts)
    touched = wrong if kind == "touches" else certified
    made = _simulated(seed, touched)
    known = wrong if kind == "certificate" else certified
    arm = suta_job().arm
    calibration, validation = (
        PairwiseDistance(ArmPoses(arm, _samples(made, name)), known, NOISE)
        for name in ("calibration", "validation")
    )
    gross = sum(len(f.outliers) for f in made.files if f.path.startswith("calibration"))
    return Study(calibration, validation, gross)


def _simulated(seed: int, touched: Artefact) -> Simulation:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "artefact.yaml"
        write_artefact(file, touched)
        sets = tuple(
            replace(s, artefact=file if s.name == "calibration" else s.artefact)
            for s in description().sets
        )
        return simulate(replace(description(), sets=sets), seed)


def _samples(made: Simulation, name: str) -> Samples:
    return Samples.concatenate([f.samples for f in made.files if f.path.startswith(name)])


def displaced_landmark(seed: int, size: float = 2e-3) -> tuple[str, FloatArray]:
    """Any landmark, displaced in any direction by ``size``, m."""
    rng = np.random.default_rng([5, seed])
    names = list(read_artefact(SUTA / "artefact.yaml").landmarks)
    direction = rng.standard_normal(3)
    return str(rng.choice(names)), size * direction / np.linalg.norm(direction)


def named(found: Outliers) -> tuple[dict[str, int], list[str]]:
    """How many flags each landmark has, and which landmarks are outliers."""
    level = found.terms[0].level("landmarks")
    assert level is not None
    flags = {g.label: len(g.flags) for g in level.groups if g.flags}
    return flags, [g.label for g in level.outliers]
