"""Fits residual maps, and lets left-out blocks decide whether one is used.

Rows are left out in blocks, because neighbours err alike: what a map learnt from one would seem to
hold for the next. Blocks by posture hold rows with similar readings; blocks by time are stretches
of the recording, or places, because what drifts in time looks like a function of posture where the
arm moves slowly. A fifth of the blocks is left out at a time, and everything about the map is
learnt anew without them. Squared errors without and with the map are compared block by block (a
paired t test). The map is used if both tests prove it and validation rows do not contradict.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Final, Literal

import numpy as np
from scipy.cluster.vq import kmeans2

from suta_calib.analysis.residual_map.residuals import (
    TipResiduals,
    block_count,
    fitted_residuals,
    tip_residuals,
)
from suta_calib.analysis.residual_map.result import (
    SORTS,
    LeftOut,
    MapCandidate,
    ResidualMap,
    Validated,
)
from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import refuse_unusable
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.job.calibration import Calibration
from suta_calib.optional_packages import require
from suta_calib.solver.solve import Progress
from suta_calib.threads import single_threaded

EXTRA: Final = "maps"
FOLDS: Final = 5


@dataclass(frozen=True)
class ResidualMapOptions(Displayable):
    """Options of a residual map.

    Attributes:
        seed: of the blocks.
        chain: which is looked at, of a robot with several.
        anyway: use a calibration even if its verdict is bad.
    """

    seed: int = 0
    chain: str = ""
    anyway: bool = False


@single_threaded
@checked
def residual_map(
    calibration: Calibration,
    options: ResidualMapOptions = ResidualMapOptions(),
    progress: Progress | None = None,
) -> ResidualMap:
    """Look for a smooth error of the tip that a calibration leaves.

    ::

        result = calibrate("calibration.yaml")
        left = residual_map(result)
        print(left)                      # what it gains, or that there is nothing left
        tip = left.tip(q)                # m, in the base, with the correction
        plus_minus = left.std(q)

    Args:
        calibration: with observations that see the position of the tip.
        options: what is asked for.
        progress: called with (fits done, fits).

    Raises:
        SamplesError: it did not converge, no observation sees the position of the tip, or fewer
            than 30 rows do.
        UnusableResultError: its assessment says that it must not be used.
        MissingExtraError: scikit-learn is not installed.
    """
    require("sklearn", EXTRA)
    solution, file = calibration.solution, calibration.job.spec.path
    if not solution.converged:
        raise SamplesError(
            f"a calibration that may not be used ({solution.sentence})",
            "one that converged",
            file=file,
        )
    refuse_unusable(calibration.assessment, file, anyway=options.anyway)
    robot = solution.problem.arm or calibration.job.arm
    arm = robot.chosen(options.chain)
    job, seed = calibration.job, options.seed
    residuals = fitted_residuals(job.observations, arm, solution.values, seed, file)
    held_out = dict[str, TipResiduals]()
    for term, row in zip(job.validation, job.spec.validation, strict=True):
        left = tip_residuals([term], arm, calibration.accuracy.held_out_values, seed)
        if left is not None and len(left):
            name = ", ".join(row.samples) or f"{row.kind} {len(held_out) + 1}"
            held_out[name] = left
    steps = _Steps(progress)
    tried = tuple(_candidate(sort, residuals, held_out, seed, steps) for sort in SORTS)
    good = [c for c in tried if c.proven and c.confirmed]
    chosen = min(good, key=lambda c: c.tests[0].metrics[1].rms, default=None)
    return ResidualMap(arm, solution.values, residuals, tried, chosen)


@dataclass(eq=False)
class _Steps:
    """Says how far the work has come."""

    progress: Progress | None
    done: int = 0

    def __call__(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, len(SORTS) * (1 + 2 * FOLDS))


def _processes() -> Any:
    """The module that needs scikit-learn."""
    return import_module("suta_calib.analysis.residual_map.process")


def _candidate(
    sort: Any,
    residuals: TipResiduals,
    held_out: Mapping[str, TipResiduals],
    seed: int,
    steps: _Steps,
) -> MapCandidate:
    process = _processes().fitted_process(sort, residuals, seed)
    steps()
    tests = [_left_out("posture", process, residuals, seed, steps)]
    if tests[0].proven:
        tests.append(_left_out("time", process, residuals, seed, steps))
    validated = []
    for name, rows in held_out.items():
        mean, _ = process.predict(rows.q, rows.jacobian)
        before, after = (np.linalg.norm(e, axis=1) for e in (rows.error, rows.error - mean))
        validated.append(Validated(name, before, after))
    return MapCandidate(sort, tuple(tests), process, tuple(validated))


def _left_out(
    by: Literal["posture", "time"],
    process: Any,
    residuals: TipResiduals,
    seed: int,
    steps: _Steps,
) -> LeftOut:
    """Errors of all rows, each predicted by a map that has not seen its block."""
    random = np.random.default_rng(seed)
    block = _by_posture(residuals.q, seed) if by == "posture" else residuals.time
    block = np.unique(block, return_inverse=True)[1]
    fold = random.permutation(int(block.max()) + 1)[block] % FOLDS
    mean, predicted = np.zeros_like(residuals.error), np.zeros_like(residuals.error)
    for k in range(FOLDS):
        out, fitted = np.flatnonzero(fold == k), np.flatnonzero(fold != k)
        # The search begins where that of all rows ended: it is shorter, and ends where it would.
        trained = _processes().fitted_process(
            process.sort, residuals.take(fitted), seed, process.theta
        )
        mean[out], std = trained.predict(residuals.q[out], residuals.jacobian[out])
        predicted[out] = np.hypot(std, trained.noise)
        steps()
    return LeftOut(by, block, residuals.error, residuals.error - mean, predicted)


def _by_posture(q: FloatArray, seed: int) -> IntArray:
    """(n,) numbers of groups of rows with similar readings, each joint by its range."""
    scaled = (q - q.mean(axis=0)) / np.maximum(q.std(axis=0), 1e-12)
    with warnings.catch_warnings():
        # A group that stays empty is one block less.
        warnings.simplefilter("ignore", UserWarning)
        _, group = kmeans2(scaled, block_count(len(q)), minit="++", seed=seed)
    return np.asarray(group, dtype=np.intp)
