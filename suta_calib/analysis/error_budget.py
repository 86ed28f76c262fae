"""Splits the errors by source: encoders, seating, artefact, gross errors, and the model.

The mean square of a block's residuals is split into what each source is known to put there:

* gross errors: what rows beyond the block's Huber threshold, and apart from their repeats, have
  more than the others, and rows of touches that have many such (`repeats`);
* encoders: their stated noise, pushed through the kinematics;
* seating: the scatter of repeats of the same touch, or of rests at one posture, less the
  encoders';
* artefact: the certified coordinates' stated standard deviations;
* parameters (held-out data only): the covariance of the calibration;
* model: the rest, which repeats share and nothing stated explains (see `lack_of_fit`).

A seating that is off in the same way every time is no scatter: it is calibrated (the key
``seating``), or it is part of the model's share. A share that the data do not determine has no
number: its sources stand together with one number for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import sparse

from suta_calib.arguments import checked
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.model.parameters import ParameterSet
from suta_calib.model.robot import AnyArm
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import Progress
from suta_calib.terms import KINDS, Term
from suta_calib.terms.block import Block
from suta_calib.threads import single_threaded
from suta_calib.trust.accuracy import fit_own
from suta_calib.trust.repeats import gross_rows, one_of_each_rest, repeat_variance
from suta_calib.units import Unit, text

Source = Literal["gross", "encoders", "seating", "instrument", "artefact", "parameters", "model"]
WORDS: Final[dict[Source, str]] = {
    "encoders": "encoders",
    "seating": "seating",
    "instrument": "instrument",
    "artefact": "artefact",
    "parameters": "uncertainty of the calibration",
    "model": "model error (the rest)",
    "gross": "gross errors",
}


@dataclass(frozen=True)
class EncoderNoise:
    """Known noise of the encoders.

    Attributes:
        bits: revolute joints read whole steps of 2π / 2^bits; None where that is not known.
        angle: standard deviation of a revolute joint's reading beside the steps, rad.
        length: standard deviation of a prismatic joint's reading, m.
    """

    bits: int | None = None
    angle: float = 0.0
    length: float = 0.0

    def std(self, arm: AnyArm) -> FloatArray:
        """(joints,) standard deviation of each reading: steps are uniform, a twelfth of a step²."""
        step = 0.0 if self.bits is None else 2 * np.pi / 2**self.bits
        turning = float(np.hypot(step / np.sqrt(12.0), self.angle))
        prismatic = [joint.type == "prismatic" for joint in arm.readings]
        return np.where(prismatic, self.length, turning)


@dataclass(frozen=True, eq=False)
class Linear:
    """Terms at given parameter values, block by block, and the tip."""

    residuals: list[FloatArray]  # (n, d)
    # (n,) variance of a residual's norm that the encoders make, m² or rad².
    by_reading: list[FloatArray]
    by_parameters: list[FloatArray]  # (n, d, p) derivative by the arm's parameters asked for
    # (samples,) variance of the tip's position that the encoders make, m².
    tip_by_reading: FloatArray
    tip_by_parameters: FloatArray  # (samples, 3, p) derivative of the tip's position


def linear(
    terms: Sequence[Term],
    arm: AnyArm,
    names: Sequence[str],
    values: Mapping[str, float],
    std: FloatArray,
) -> Linear:
    """Residuals and derivatives by some of the arm's parameters, at values of all.

    Readings err by ``std`` (joints,), rad or m. Of a robot, the terms may be over some chains only.
    """
    # What is not estimated may still have a value: that of a job's fixed parameters is nominal.
    names_used = [n for n in (*arm.parameters, *arm.nongeometric) if n in {*names, *arm.offsets}]
    problem = Problem(terms, ParameterSet(arm.offered[n] for n in names_used))
    x = np.array([values.get(p.name, p.nominal) for p in problem.parameters.values()])
    lines = problem.linearise(x, problem.assumed_sigmas())
    velocity = problem.evaluation.table.velocity
    by_joint = velocity[:, [names_used.index(n) for n in arm.offsets]] @ arm.gearing
    chosen = [names_used.index(n) for n in names]
    rows = np.arange(len(velocity))
    samples = rows // 6
    residuals, by_reading, by_parameters = [], [], []
    for line in lines:
        error, relative = line.error, line.view.block.relative
        n, size = error.shape
        motion = line.pattern.by_velocity(line.by_pose)
        residuals.append(error)
        # If the readings of the samples have independent errors.
        variance = np.zeros(motion.shape[0])
        for column, level in zip(by_joint.T, std, strict=True):
            block = sparse.csr_array((column, (rows, samples)))
            variance += np.asarray((motion @ block).power(2).sum(axis=1)).reshape(-1) * level**2
        by_reading.append((variance.reshape(n, size) * relative**2).sum(axis=1))
        moves = (motion @ velocity[:, chosen]).reshape(n, size, len(chosen))
        by_parameters.append(moves * relative[:, :, None])
    moved = velocity.reshape(-1, 6, len(names_used))[:, :3]
    tip = np.einsum("nij,j->n", by_joint.reshape(-1, 6, len(std))[:, :3] ** 2, std**2)
    return Linear(residuals, by_reading, by_parameters, tip, moved[:, :, chosen])


@dataclass(frozen=True)
class Share:
    """Part of the mean square (m², rad²) from one source, or from several together."""

    sources: tuple[Source, ...]
    variance: float

    @property
    def rms(self) -> float:
        """Root of the part, m or rad."""
        return float(np.sqrt(self.variance))

    @property
    def words(self) -> str:
        """``seating``, or ``encoders and seating together``."""
        words = [word for source, word in WORDS.items() if source in self.sources]
        if len(words) == 1:
            return words[0]
        return f"{', '.join(words[:-1])} and {words[-1]} together"


@dataclass(frozen=True)
class BlockBudget:
    """One block of one term."""

    data: str  # ``calibration`` or ``validation``
    kind: str  # of the term
    block: str  # ``distance``, ``position`` or ``rotation``
    unit: Unit  # m or rad
    shares: tuple[Share, ...]  # they add up to ``variance``
    variance: float  # mean square of their norms, what was read at one rest counted once
    count: int  # of residuals, those of one rest counted once
    overstated: bool = False  # whether the encoders' stated noise is more than repeats scatter
    per_position: float = 1.0  # variance of a touched position over that of a residual's norm
    chain: str = ""  # of which chain of a robot; empty where it has only one

    def variance_of(self, *sources: Source) -> float | None:
        """Of exactly these sources, or None where they have no number of their own."""
        variances = [s.variance for s in self.shares if set(s.sources) == set(sources)]
        return variances[0] if variances else None

    @property
    def inside(self) -> list[Share]:
        """The shares without gross errors."""
        return [s for s in self.shares if s.sources != ("gross",)]

    @property
    def rms(self) -> float:
        """Root of the mean square, m or rad."""
        return float(np.sqrt(self.variance))


@dataclass(frozen=True)
class TipBudget:
    """Mean square of the tip's position error at the postures that were visited, m²."""

    encoders: float | None  # of a single reading; None where nothing is known of them
    parameters: float  # from the covariance of the calibration, relative to what was held
    model: float | None  # as the first block of lengths shows it; None where it has no number

    @property
    def rms(self) -> float:
        """Of everything that has a number, m."""
        return float(np.sqrt(sum(v for v in (self.encoders, self.parameters, self.model) if v)))


@dataclass(frozen=True)
class ErrorBudget(Displayable):
    """The budget of a calibration.

    Attributes:
        blocks: of the observations, then of the validation data.
        tip: what it means for the tip in use.
        missing: what must be known for a finer split, one sentence each.
    """

    blocks: tuple[BlockBudget, ...]
    tip: TipBudget
    missing: tuple[str, ...]

    @property
    @judged
    def assessment(self) -> Assessment:
        """The largest source, and what the data do not show: lengths and validation data first."""
        first = min(self.blocks, key=lambda b: (b.data != "validation", b.unit != "m"))
        largest = max(first.inside, key=lambda s: s.variance)
        total = sum(s.variance for s in first.inside)
        errors = f"{first.data} errors ({text(first.rms, first.unit, with_unit=True)} RMS)"
        sentence = f"The {errors} are zero: there is nothing to divide"
        if total > 0:
            part = text(largest.variance / total, "%", decimals=0, with_unit=True)
            sentence = (
                f"Largest part of the {errors}, without gross errors: {part} is {largest.words}"
            )
        care = [*self.missing]
        shares = [
            ((b.variance_of("gross") or 0.0) / b.variance, b.data)
            for b in self.blocks
            if b.variance
        ]
        # Half of a mean square are errors to look for, not to split.
        worst, data = max(shares, default=(0.0, ""))
        if worst >= 0.5:
            part = text(worst, "%", decimals=0, with_unit=True)
            care.append(
                f"Gross errors make up {part} of the mean square of the {data} errors. The command "
                "suta-calib outliers shows which touches they are."
            )
        return Assessment.of(sentence, care=care)


def error_budget_of_job(
    job: CalibrationJob, progress: Progress | None = None, *, anyway: bool = False
) -> ErrorBudget:
    """Calibrate a job and split its errors; its section ``encoders`` states the encoder noise."""
    stated = job.spec.encoders
    encoders = (
        None if stated is None else EncoderNoise(stated.bits, stated.noise_rad, stated.noise_m)
    )
    return error_budget(job.usable_solution(progress, anyway=anyway), job.validation, encoders)


@single_threaded
@checked
def error_budget(
    solution: Solution, validation: Sequence[Term] = (), encoders: EncoderNoise | None = None
) -> ErrorBudget:
    """Split the residuals of a calibration by their sources.

    Args:
        solution: a converged one, over an arm.
        validation: terms that were not fitted.
        encoders: what is known of them; their share has no number without.

    Raises:
        ParameterError: there is no arm.
    """
    problem = solution.problem
    if problem.arm is None:
        raise ParameterError("no arm among the observations", "one", where="error budget")
    names = problem.arm_parameters.names
    std = (encoders or EncoderNoise()).std(problem.arm)
    at = linear(problem.terms, problem.arm, names, solution.values, std)
    encoders_stated = encoders is not None
    blocks = _blocks("calibration", problem.terms, at, encoders_stated, None)
    covariance = solution.covariance[: len(names), : len(names)]
    if validation:
        values = fit_own(validation, problem.arm_parameters, solution.values)
        held_out = linear(validation, problem.arm, names, values, std)
        joint_covariance = solution.covariance_seen_by(validation)[: len(names), : len(names)]
        blocks += _blocks("validation", validation, held_out, encoders_stated, joint_covariance)
    # The model's share of a position, best from validation data.
    lengths = sorted((b for b in blocks if b.unit == "m"), key=lambda b: b.data != "validation")
    model = lengths[0].variance_of("model") if lengths else None
    tip = TipBudget(
        float(at.tip_by_reading.mean()) if encoders_stated else None,
        _mean_variance(at.tip_by_parameters, covariance),
        None if model is None else lengths[0].per_position * model,
    )
    return ErrorBudget(tuple(blocks), tip, _missing(blocks, encoders_stated))


def _blocks(
    data: str,
    terms: Sequence[Term],
    at: Linear,
    encoders_stated: bool,
    covariance: FloatArray | None,
) -> list[BlockBudget]:
    budgets, by_block = [], iter(zip(at.residuals, at.by_reading, at.by_parameters, strict=True))
    # Stated encoder noise over the scatter of repeats, as variances, from which it cannot be so
    # large.
    too_large = 1.5
    for term in terms:
        for block in term.blocks:
            # Readings repeated at one rest add no information on the sources.
            once = one_of_each_rest(term, block)
            residual, by_reading, by_parameters = (array[once] for array in next(by_block))
            stated: dict[Source, float | None] = {
                "encoders": float(by_reading.mean()) if encoders_stated else None,
                # Stated variance of the certified coordinates; None where none is stated.
                "artefact": 0.0,
            }
            if block.certified is not None:
                artefact = float(block.size * np.mean(block.known_sigma[once] ** 2))
                stated["artefact"] = artefact or None
            if covariance is not None:
                stated["parameters"] = _mean_variance(by_parameters, covariance)
            shares = _shares(term, replace(block, samples=block.samples[once]), residual, stated)
            budget = next((s.variance for s in shares if s.sources == ("encoders",)), 0.0)
            budgets.append(
                BlockBudget(
                    *(data, term.kind, block.name, block.unit, shares),
                    variance=float(np.mean(np.sum(residual**2, axis=1))),
                    count=len(once),
                    overstated=0.0 < too_large * budget < (stated["encoders"] or 0.0),
                    # A position has three coordinates; a distance sees one of each of its ends.
                    per_position=3.0 / (block.size * term.noise_factor**2),
                    chain=term.poses.chain,
                )
            )
    return budgets


def _shares(
    term: Term, block: Block, residual: FloatArray, stated: dict[Source, float | None]
) -> tuple[Share, ...]:
    touch = term.clusters
    squares = np.sum(residual**2, axis=1)
    sound = ~gross_rows(block, residual, touch)
    inside = min(float(squares[sound].mean()) if sound.any() else 0.0, float(squares.mean()))
    shares = [Share(("gross",), float(squares.mean()) - inside)]
    touching: Source = "seating" if term.medium == "touch" else "instrument"
    scatter = repeat_variance(block, residual, touch, sound)
    left, unknown = inside, list[Source]()
    if scatter is not None:
        left -= (scatter := min(scatter, inside))
        if stated["encoders"] is None:
            shares.append(Share(("encoders", touching), scatter))
        else:
            part = min(stated["encoders"], scatter)
            shares += [Share(("encoders",), part), Share((touching,), scatter - part)]
    elif stated["encoders"] is not None:
        left -= (part := min(stated["encoders"], left))
        shares.append(Share(("encoders",), part))
        unknown.append(touching)
    else:
        unknown += ["encoders", touching]
    for source in ("artefact", "parameters"):
        variance = stated.get(source, 0.0)
        if variance is None:
            unknown.append(source)
        elif variance:
            left -= (part := min(variance, left))
            shares.append(Share((source,), part))
    return (*shares, Share((*unknown, "model"), max(left, 0.0)))


def _mean_variance(derivative: FloatArray, covariance: FloatArray) -> float:
    """Mean over the rows (n, d, p) of the trace of J Σ Jᵀ."""
    return float(np.einsum("ndp,pq,ndq->", derivative, covariance, derivative) / len(derivative))


def _missing(blocks: Sequence[BlockBudget], encoders_stated: bool) -> tuple[str, ...]:
    together = [s.sources for b in blocks for s in b.shares if len(s.sources) > 1]
    notes = []
    if not encoders_stated:
        notes.append(
            "The noise of the encoders is not given, so their share is not shown separately. Add "
            "encoders: {bits: …, noise_deg: …} to the job."
        )
    # How to separate scatter from model errors, for the kinds that show them together.
    mixed = {
        b.kind
        for b in blocks
        for s in b.shares
        if "model" in s.sources and ("seating" in s.sources or "instrument" in s.sources)
    }
    repeatable = {b.kind for b in blocks if "repeat" in KINDS[b.kind].columns.labels}
    if mixed & repeatable:
        notes.append(
            "Too few touches were repeated, so repeatability and model errors are shown "
            "together. Touch every landmark again, at least twice (column repeat)."
        )
    if (unrepeatable := sorted(mixed - repeatable)) and not repeatable - mixed:
        notes.append(
            f"{' and '.join(unrepeatable)} {('have' if len(unrepeatable) > 1 else 'has')} no "
            "repeats of the same posture, so repeatability and model errors are shown together "
            "there. To separate them, touch an artefact at least twice at each placement."
        )
    if any(b.overstated for b in blocks):
        notes.append(
            "The given encoder noise is larger than the scatter of repeats allows. The encoders' "
            "share of the error is limited to that scatter. Check the given noise."
        )
    if any("artefact" in s for s in together):
        notes.append(
            "The artefact gives no uncertainty, so its share is not shown separately. Give its "
            "landmarks sigma_mm."
        )
    return tuple(notes)
