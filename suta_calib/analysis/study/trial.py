"""One calibration of a study: draw or simulate, solve, look at held-out data.

A trial is a function of the study's data and of (kind, size, trial) alone: its random numbers hang
on these, and it starts from nominal. So it gives the same numbers wherever and whenever it runs.

What is drawn is a *set*: what a protocol measures in one go, so that it is drawn or left as a
whole. Where samples have a placement and a repeat, that is one round over the artefact: distances
exist only within it.

Where the measurement is simulated, a solution is taken for the truth: samples that touched
something get readings that bring the calibrated tip to where it should have been, plus noise: the
nearest posture to the measured one. Samples that were seen from afar get what the instrument would
have seen, plus noise. Noise is normal, of the size the residuals showed. What each kind touches or
sees is its own to say (`Term.observed`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError, did_you_mean
from suta_calib.measurements.samples import joined
from suta_calib.model.parameters import ParameterSet
from suta_calib.simulation.inverse_kinematics import InverseKinematics, Targets
from suta_calib.simulation.noise import scattered_rotations, stream
from suta_calib.solver.compiled_residual import TermErrors
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution, State
from suta_calib.solver.solve import solve
from suta_calib.terms import KINDS, Term
from suta_calib.terms.observed import Observed
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.threads import single_threaded
from suta_calib.trust.accuracy import fit_own

SAMPLE: Final = "sample"
# What may be drawn, and which label columns make two samples belong together: whatever the kinds
# group by where they touched, or samples one by one.
UNITS: Final[dict[str, tuple[str, ...]]] = {
    noun: columns
    for kind in KINDS.values()
    for noun, columns in kind.groupings.items()
    if kind.place in columns
} | {SAMPLE: ()}


@dataclass(frozen=True, eq=False)
class Sets:
    """What is drawn, and which samples it takes along."""

    unit: str  # what one set is, of `UNITS`
    names: tuple[str, ...]  # of the sets, in order of first appearance
    # For each term the set (samples,) of each sample; None for a term without such sets, which is
    # kept whole.
    members: tuple[IntArray | None, ...]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def kept_whole(self) -> tuple[int, ...]:
        """Numbers of the terms that every draw contains whole."""
        return tuple(k for k, members in enumerate(self.members) if members is None)

    def take(self, terms: Sequence[Term], chosen: Sequence[int]) -> tuple[Term, ...]:
        """The terms over the chosen sets; a term that has no sample in them is left out.

        A set that comes twice is measured twice: its copies do not pair with each other.
        """
        parts = []
        for term, members in zip(terms, self.members, strict=True):
            if members is None:
                parts.append(term)
            elif np.isin(members, chosen).any():
                parts.append(self._drawn(term, members, chosen))
        return tuple(parts)

    def rest(self, terms: Sequence[Term], chosen: Sequence[int]) -> tuple[Term, ...]:
        """The terms over the sets that were not chosen, without those that are kept whole."""
        left = np.setdiff1d(np.arange(len(self)), chosen)
        parts = []
        for term, members in zip(terms, self.members, strict=True):
            if members is not None and np.isin(members, left).any():
                parts.append(term.take(np.isin(members, left)))
        return tuple(parts)

    def _drawn(self, term: Term, members: IntArray, chosen: Sequence[int]) -> Term:
        copies = [(k, c) for k, count in Counter(chosen).items() for c in range(count)]
        rows = [np.flatnonzero(members == k) for k, _ in copies]
        copy = np.repeat([c for _, c in copies], [len(r) for r in rows])
        index = np.concatenate(rows)
        if not copy.any():
            # In the order they were measured: the same set of sets is the same problem.
            return term.take(np.sort(index))
        assert isinstance(term.poses, ArmPoses)
        samples = term.poses.samples.take(index)
        if "repeat" in samples.labels:
            # Copies are further repeats: distances are formed within a repeat.
            pairs = zip(samples.labels["repeat"], copy, strict=True)
            repeats = [f"{repeat}~{c + 1}" if c else str(repeat) for repeat, c in pairs]
            samples = replace(samples, labels={**samples.labels, "repeat": np.array(repeats)})
        return term.over_poses(ArmPoses(term.poses.arm, samples))


def sets_of(terms: Sequence[Term], unit: str | None = None) -> Sets:
    """The sets that samples of these terms form; a label in two terms is one set.

    A set is by default one placement and repeat where any term has them; else ``point``, or what
    else is touched, where there are four or more; else ``sample``.
    """
    unit = _natural(terms) if unit is None else unit
    if unit not in UNITS:
        hint = did_you_mean(unit, UNITS)
        raise SamplesError(repr(unit), f"one of {', '.join(UNITS)}", where="unit", hint=hint)
    labelled: list[list[str] | None] = []
    for k, term in enumerate(terms):
        labels = term.poses.samples.labels
        if unit == SAMPLE:
            labelled.append([f"{k + 1}:{row + 1}" for row in range(len(term.poses))])
        elif all(name in labels for name in UNITS[unit]):
            labelled.append([str(name) for name in joined(labels, UNITS[unit])])
        else:
            labelled.append(None)
    names = tuple(dict.fromkeys(name for labels in labelled for name in labels or ()))
    if not names:
        raise SamplesError(
            f"no samples with labels {' and '.join(UNITS[unit])}",
            "an observation whose samples have these labels",
            where="observations",
            hint="draw another unit, for example sample",
        )
    if len(names) == 1:
        raise SamplesError(
            f"only one {unit} ({names[0]})",
            "at least 2 to draw from",
            where="observations",
            hint="measure more of them, or draw a smaller unit, for example sample",
        )
    index = {name: k for k, name in enumerate(names)}
    members = tuple(
        None if labels is None else np.array([index[n] for n in labels], dtype=np.intp)
        for labels in labelled
    )
    return Sets(unit, names, members)


def _natural(terms: Sequence[Term]) -> str:
    """The smallest sets of the first kind that touches an artefact; else places, if enough."""
    artefacts = [list(term.groupings) for term in terms if term.needs_artefact]
    if artefacts:
        return next(unit for unit in reversed(artefacts[0]) if unit in UNITS)
    places: dict[str, set[str]] = {}
    for term in terms:
        if term.place:
            names = term.poses.samples.labels[term.place]
            places.setdefault(term.place, set()).update(map(str, names))
    # Fewer points than this, or other places, leave too few subsets to choose from: then touches
    # are drawn one by one.
    return next((place for place in places if len(places[place]) >= 4), SAMPLE)


def described(unit: str) -> str:
    """What one set is, for a sentence."""
    columns = UNITS[unit]
    if len(columns) > 1:
        return f"one {' and '.join(columns)}"
    if not columns:
        return f"one {unit}"
    on_artefact = any(kind.needs_artefact for kind in KINDS.values() if kind.place == unit)
    return f"one {unit} with all its repeats" if on_artefact else f"all touches of one {unit}"


Kind = Literal["size", "bootstrap", "monte-carlo"]
# What the files of each kind are called.
NAMES: Final[dict[Kind, str]] = {
    "size": "study",
    "bootstrap": "bootstrap",
    "monte-carlo": "monte_carlo",
}
# States in which the data say something about a value.
ESTIMATED: Final[tuple[State, ...]] = ("identified", "prior")


@dataclass(frozen=True)
class FullDataFit:
    """The calibration with all data: values (m, rad) by name, and the noise found in each block.

    ``given`` has for each estimated parameter of the arm the held ones its value is relative to.
    """

    values: Mapping[str, float]
    noise: Sequence[float]
    given: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, solution: Solution) -> FullDataFit:
        """What a solution says."""
        arm = [solution.estimates[name] for name in solution.problem.arm_parameters]
        given = {e.name: e.given for e in arm if e.state in ESTIMATED}
        return cls(solution.values, solution.noise, given)


@dataclass(frozen=True, eq=False)
class StudyData:
    """Everything a trial needs: arrays and names only, so that it can be sent to a worker.

    Without ``validation`` terms the sets not drawn are held out. The solver's ``options`` have one
    start, from nominal; ``reference`` is the calibration with all data, but for a study of sizes.
    """

    kind: Kind
    seed: int
    parameters: ParameterSet
    terms: tuple[Term, ...]
    validation: tuple[Term, ...]
    sets: Sets
    options: SolverOptions = SolverOptions()
    reference: FullDataFit | None = None

    @property
    def judged_by(self) -> Term:
        """The term whose kind of error counts: the first held out, or the first drawn."""
        if self.validation:
            return self.validation[0]
        return next(t for k, t in enumerate(self.terms) if k not in self.sets.kept_whole)

    def chosen(self, size: int, trial: int) -> tuple[int, ...]:
        """Numbers of the sets of one trial, ascending; with repeats in a bootstrap."""
        if self.kind == "monte-carlo":
            return tuple(range(len(self.sets)))
        random = stream(self.seed, self.kind, str(size), str(trial))
        drawn = random.choice(len(self.sets), size, replace=self.kind == "bootstrap")
        return tuple(sorted(int(k) for k in drawn))


@dataclass(frozen=True)
class Trial(Displayable):
    """What came of one calibration.

    Attributes:
        size: how many sets were drawn.
        number: of the trial among those of its size, from 0.
        problem: why there is no result; empty where there is one.
        rms: of the held-out errors, in SI; NaN where there is no result or nothing was held out.
        estimates: value and standard deviation, m or rad, of each parameter of the arm that was
            told, relative to the same held ones as with all data.
    """

    size: int
    number: int
    problem: str = ""
    rms: float = math.nan
    estimates: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@single_threaded
def run_trial(data: StudyData, size: int, number: int) -> Trial:
    """One trial; what cannot be solved says why."""
    try:
        terms, held_out = _drawn(data, size, number)
        # If only validation errors count, the covariance is not needed.
        solution = solve(
            Problem(terms, data.parameters), data.options, spread=data.reference is not None
        )
        if not solution.converged:
            return Trial(size, number, solution.sentence)
        rms = held_out_rms(solution, held_out)
        if data.kind == "size" and math.isnan(rms):
            return Trial(
                size, number, f"no {data.judged_by.kind} among the sets that were not drawn"
            )
    except InputError as problem:
        return Trial(size, number, " ".join(str(problem).split()))
    except np.linalg.LinAlgError as problem:
        return Trial(size, number, f"numerically singular: {problem}")
    return Trial(size, number, "", rms, _estimates(solution, data.reference))


def held_out_rms(solution: Solution, validation: Sequence[Term]) -> float:
    """RMS of held-out errors, in SI, with the calibrated arm held; NaN without terms.

    It is the figure `assess` finds after calibration, without those before.
    """
    return _rms(validation, solution.problem.arm_parameters, solution.values)


def nominal_rms(data: StudyData) -> float:
    """RMS of held-out errors, in SI, with the nominal arm; NaN where the job holds nothing out."""
    if not data.validation:
        return math.nan
    nominal = {p.name: p.nominal for p in data.parameters.values()}
    fitted = fit_own(data.terms, data.parameters, nominal)
    return _rms(data.validation, data.parameters, fitted)


def _rms(validation: Sequence[Term], arm: ParameterSet, values_known: Mapping[str, float]) -> float:
    """Over all terms of the first one's kind; own unknowns that are not known are fitted."""
    if not validation:
        return math.nan
    unknown = {p.name for term in validation for p in term.own_parameters} - values_known.keys()
    values = fit_own(validation, arm, values_known) if unknown else values_known
    same = tuple(term for term in validation if term.kind == validation[0].kind)
    first = [errors(values)[0] for errors in _judges(same, arm.names)]
    squared = [np.einsum("nd,nd->n", residuals, residuals) for residuals in first]
    return float(np.sqrt(np.mean(np.concatenate(squared))))


@lru_cache(maxsize=1)
def _judges(terms: tuple[Term, ...], names: tuple[str, ...]) -> tuple[TermErrors, ...]:
    """What trial after trial is judged by."""
    return tuple(TermErrors(term, names) for term in terms)


def _drawn(data: StudyData, size: int, number: int) -> tuple[Sequence[Term], Sequence[Term]]:
    """Terms to fit, and terms to look at."""
    if data.kind == "monte-carlo":
        assert data.reference is not None
        random = stream(data.seed, data.kind, str(number))
        reference = data.reference
        return resimulated(data.terms, reference.values, reference.noise, random), data.validation
    chosen = data.chosen(size, number)
    terms = data.sets.take(data.terms, chosen)
    if data.validation:
        return terms, data.validation
    kind = data.judged_by.kind
    return terms, [t for t in data.sets.rest(data.terms, chosen) if t.kind == kind]


def _estimates(solution: Solution, reference: FullDataFit | None) -> dict[str, tuple[float, float]]:
    """Values that mean the same as with all data: told, and relative to the same held ones."""
    if reference is None:
        return {}
    comparable = {}
    for name, given in reference.given.items():
        estimate = solution.estimates[name]
        if estimate.state in ESTIMATED and set(estimate.given) == set(given):
            assert estimate.std is not None
            comparable[name] = (estimate.value, estimate.std)
    return comparable


def resimulated(
    terms: Sequence[Term],
    values: Mapping[str, float],
    noise: Sequence[float],
    random: np.random.Generator,
) -> tuple[Term, ...]:
    """The terms over simulated samples, as many as there were and in nearly the same postures.

    ``values``, m or rad, are taken for the truth; ``noise`` is that of a component of the residual
    of each block of each term, in order.
    """
    levels, noisy = iter(noise), _Noisy(values, random)
    return tuple(
        term.resimulated(values, [next(levels) for _ in term.blocks], noisy) for term in terms
    )


@dataclass(frozen=True, eq=False)
class _Noisy:
    """A `Resimulation` by inverse kinematics and normal noise."""

    values: Mapping[str, float]
    random: np.random.Generator

    def touched(self, poses: PoseSource, target: FloatArray, sigma: float) -> PoseSource:
        assert isinstance(poses, ArmPoses)
        rotation, _ = poses.at(self.values)
        reached = target + sigma * self.random.standard_normal(target.shape)
        kinematics = InverseKinematics(poses.arm, self.values)
        targets = Targets(reached, rotation, "position")
        answer = kinematics.solve(targets, poses.samples.q, self.random, starts=1)
        for row in np.flatnonzero(answer.distance > max(sigma, 1e-6) / 10):
            raise SamplesError(
                "a sample whose touch cannot be simulated: no posture nearby reaches it",
                "an arm that can move its tip in all three directions there",
                where=poses.samples.origin[int(row)],
            )
        return poses.with_samples(replace(poses.samples, q=answer.q))

    def observed(
        self, poses: PoseSource, ideal: Observed, noise: Mapping[str, float], relative: FloatArray
    ) -> PoseSource:
        samples, normal = poses.samples, self.random.standard_normal
        if ideal.pixels is not None:
            pixels = ideal.pixels + noise["pixels"] * normal(ideal.pixels.shape)
            return poses.with_samples(replace(samples, pixels=pixels))
        if ideal.position is not None:
            scatter = noise["position"] * relative * normal(ideal.position.shape)
            samples = replace(samples, position=ideal.scattered(scatter))
        if ideal.rotation is not None and "rotation" in noise:
            samples = replace(samples, rotation=self.turned(ideal.rotation, noise["rotation"]))
        numbers = {n: v + noise[n] * normal(v.shape) for n, v in ideal.numbers.items()}
        return poses.with_samples(replace(samples, numbers={**samples.numbers, **numbers}))

    def turned(self, rotation: FloatArray, sigma: float) -> FloatArray:
        return np.asarray(rotation @ scattered_rotations(self.random, sigma, len(rotation)))
