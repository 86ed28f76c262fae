"""What others make of a measured job: plain SciPy and pybotics here, figaroh in its interpreter.

Each gives the positions that it predicts for samples it has not seen, m.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pybotics_peer
from peers import tip_positions
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from suta_calib import ArmModel, CalibrationJob, Samples, Term, TouchedLandmark
from suta_calib.arrays import FloatArray
from suta_calib.geometry import homogeneous, register_points, vector_from_rotation
from suta_calib.model import dh_table
from suta_calib.units import from_mm

# Scatter of a measured coordinate that priors are weighed with: nobody knows it before the fit.
ASSUMED_NOISE = from_mm(0.5)
SCRIPT = Path(__file__).with_name("figaroh_peer.py")
TIMEOUT_S = 600.0
MOST_EVALUATIONS = 200
STOPPED = f"stopped after {MOST_EVALUATIONS} evaluations, before it converged"


class CannotRunError(Exception):
    """A peer that has no way to do a job; why."""


@dataclass(frozen=True)
class Answer:
    """A peer's held-out errors.

    Attributes:
        errors: (n,) of every held-out sample, m.
        seconds: processor time from measurements to answer.
        memory_mb: most that the process had, its libraries included; None where not its own.
        note: what must be known of it.
    """

    errors: FloatArray
    seconds: float
    memory_mb: float | None = None
    note: str = ""


def frame(x: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, 3) moved by a position and a rotation vector, (6,)."""
    return Rotation.from_rotvec(x[3:]).apply(points) + x[:3]


def registered(points: FloatArray, seen: FloatArray) -> FloatArray:
    """The position and rotation vector (6,) that take points to where they were seen."""
    R, p = register_points(points, seen)
    return np.concatenate([p, vector_from_rotation(R)])


class PlainScipy:
    """The job as one call of `scipy.optimize.least_squares`, kinematics in NumPy.

    Everything that the job names is unknown, and the pose of the instrument or of each placement;
    loss, priors and start as the job has them, the Jacobian by differences. What the data cannot
    tell stays where the trust region leaves it.
    """

    def __init__(self, job: CalibrationJob) -> None:
        term = only_term(job)
        self.job, self.samples = job, term.poses.samples
        self.target, self.groups = seen_and_groups(term)
        self.unknowns = [p for p in job.parameters.values() if p.free]
        if any(not p.geometric for p in self.unknowns):
            raise CannotRunError("it knows geometry only; the job has eccentricity or compliance")
        self.huber = job.spec.observations[0].huber_m or np.inf

    def errors(self, values: Mapping[str, float], frames: Mapping[str, FloatArray]) -> FloatArray:
        """(n, 3) of the fitted samples, m."""
        tip = tip_positions(self.job.arm, self.samples.q, values)
        found = np.empty_like(tip)
        for name, pose in frames.items():
            rows = self.groups == name
            found[rows] = frame(pose, tip[rows]) - self.target[rows]
        return found

    def solve(self) -> Answer:
        """Fit, then predict every validation term."""
        began = process_time()
        names, groups = [p.name for p in self.unknowns], np.unique(self.groups).tolist()
        nominal = np.array([p.nominal for p in self.unknowns])
        weight = np.array([ASSUMED_NOISE / p.prior if p.prior else 0.0 for p in self.unknowns])
        tip = tip_positions(self.job.arm, self.samples.q, {})
        starts = [registered(tip[self.groups == g], self.target[self.groups == g]) for g in groups]

        def unpack(x: FloatArray) -> tuple[dict[str, float], dict[str, FloatArray]]:
            poses = x[len(names) :].reshape(-1, 6)
            return dict(zip(names, x[: len(names)], strict=True)), dict(
                zip(groups, poses, strict=True)
            )

        def residuals(x: FloatArray) -> FloatArray:
            size = np.linalg.norm(errors := self.errors(*unpack(x)), axis=1)
            # Huber on the norm, as a factor: SciPy's own loss would take every coordinate apart.
            beyond = np.maximum(size, self.huber)
            factor = np.sqrt(self.huber * (2 * beyond - self.huber)) / beyond
            robust = errors * np.where(size > self.huber, factor, 1.0)[:, None]
            return np.concatenate([robust.ravel(), weight * (x[: len(names)] - nominal)])

        start = np.concatenate([nominal, *starts])
        found = least_squares(residuals, start, x_scale="jac", max_nfev=MOST_EVALUATIONS)
        seconds = process_time() - began
        values, frames = unpack(found.x)
        errors = [self.held_out(term, values, frames) for term in self.job.validation]
        note = "" if found.status > 0 else STOPPED
        return Answer(np.concatenate(errors), seconds, note=note)

    def held_out(
        self, term: Term, values: Mapping[str, float], frames: Mapping[str, FloatArray]
    ) -> FloatArray:
        """(n,) errors of a validation term; what it has of its own is registered."""
        target, groups = seen_and_groups(term)
        tip = tip_positions(self.job.arm, term.poses.samples.q, values)
        found = np.empty(len(tip))
        for name in np.unique(groups):
            rows = groups == name
            pose = frames[name] if name in frames else registered(tip[rows], target[rows])
            found[rows] = np.linalg.norm(frame(pose, tip[rows]) - target[rows], axis=1)
        return found


def only_term(job: CalibrationJob) -> Term:
    """What a job of one arm fits, where that is all of one kind."""
    if not isinstance(job.arm, ArmModel):
        raise CannotRunError("it fits one arm; the job has several chains")
    if len(job.observations) != 1:
        raise CannotRunError("it fits one list of samples; the job has several")
    return job.observations[0]


def tracked_term(job: CalibrationJob) -> Term:
    """What a job fits, where that is positions which one instrument tracked."""
    term = only_term(job)
    if term.kind != "tracked_point" or term.poses.samples.rotation is not None:
        kind = f"{term.kind} with orientation" if term.kind == "tracked_point" else term.kind
        raise CannotRunError(f"it fits tracked positions only; the job is of the kind {kind}")
    if any(other.label != term.label for other in job.validation):
        raise CannotRunError("it fits one instrument; the job has several")
    return term


def seen_and_groups(term: Term) -> tuple[FloatArray, Any]:
    """Where the tip has to be (n, 3), m, and in which frame: an instrument's, a placement's."""
    samples: Samples = term.poses.samples
    if term.kind == "tracked_point" and samples.rotation is None:
        assert samples.position is not None
        return samples.position, np.full(len(samples.q), f"instrument {term.label}")
    if isinstance(term, TouchedLandmark) and len(term.blocks) == 1:
        touched = term.artefact.position_of(samples.labels["landmark"])
        return touched, np.array(samples.labels["placement"])
    raise CannotRunError(f"it knows tracked positions and landmarks; the job has {term.kind}")


def pybotics(job: CalibrationJob, folder: Path, residuals: pybotics_peer.Residuals) -> Answer:
    """The job by pybotics and SciPy's least squares: tracked points, one instrument, a serial arm.

    Raises:
        CannotRunError: another kind, or an arm that has no table of this sort; why.
    """
    term = tracked_term(job)
    if job.arm.chain.loops or any(
        j.moving and (j.climbed or j.mimic) for j in job.arm.chain.joints
    ):
        raise CannotRunError("it fits serial arms; a joint of this one follows others")
    if any(not p.geometric for p in job.parameters.values()):
        raise CannotRunError("it knows geometry only; the job has eccentricity or compliance")
    fit = term.poses.samples
    turn = registered(job.arm.forward(fit.q)[1], fit.position)
    instrument = homogeneous(Rotation.from_rotvec(turn[3:]).as_matrix(), turn[:3])
    held_out = [other.poses.samples for other in job.validation]
    found, seconds, converged = pybotics_peer.predicted(
        folder,
        dh_table(job.arm, convention="modified"),
        instrument,
        fit,
        np.concatenate([s.q for s in held_out]),
        residuals,
        MOST_EVALUATIONS,
    )
    errors = np.linalg.norm(found - np.concatenate([s.position for s in held_out]), axis=1)
    return Answer(errors, seconds, note="" if converged else STOPPED)


def figaroh(job: CalibrationJob, python: str, level: str = "full_params") -> Answer:
    """The job by figaroh, in the interpreter that has it: tracked points, one instrument.

    Raises:
        CannotRunError: another kind, or it failed; why.
    """
    fit = tracked_term(job).poses.samples
    _, position = job.arm.forward(fit.q)
    turn = registered(position, fit.position)
    euler = Rotation.from_rotvec(turn[3:]).as_euler("xyz")
    held_out = [other.poses.samples for other in job.validation]
    asked = {
        "urdf": str(job.spec.arm.urdf.resolve()),
        "tip": job.spec.arm.tip,
        "level": level,
        "base_pose": [*turn[:3], *euler],
        "fit": {"joints": readings(job, fit.q), "position": fit.position.tolist()},
        "predict": {"joints": readings(job, np.concatenate([s.q for s in held_out]))},
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "job.json"
        file.write_text(json.dumps(asked), encoding="utf-8")
        command = [python, str(SCRIPT), str(file)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=TIMEOUT_S
        )
    if done.returncode:
        raise CannotRunError((done.stderr.strip().splitlines() or ["no message"])[-1])
    found = json.loads(done.stdout)
    seen = np.concatenate([s.position for s in held_out])
    errors = np.linalg.norm(np.array(found["predicted"]) - seen, axis=1)
    return Answer(errors, found["seconds"], found["memory_mb"])


def readings(job: CalibrationJob, q: FloatArray) -> dict[str, list[float]]:
    """Columns of joint readings by name."""
    return {name: q[:, k].tolist() for k, name in enumerate(job.arm.joints)}


def figaroh_version(python: str) -> str | None:
    """What an interpreter has, or None."""
    if shutil.which(python) is None:
        return None
    code = "import importlib.metadata as m; print(m.version('figaroh'))"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip() or None
