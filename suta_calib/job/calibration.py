"""A job file brought to life: the arm, its unknowns, the terms, and the run."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal

from suta_calib import plotting
from suta_calib.assessment import Assessment, attempt, judge, judged, refuse_unusable
from suta_calib.atomic import inputs_listed
from suta_calib.diagnostics.accuracy import Accuracy, TermAccuracy, fitted_too, read_where_fitted
from suta_calib.diagnostics.assessment import assess_calibration
from suta_calib.errors import InputError, JobError, ParameterError, SamplesError, SutaCalibWarning
from suta_calib.job.scene import calibration_scene
from suta_calib.job.schema import JobSpec, ObservationSpec, read_job
from suta_calib.measurements import Artefact, Samples, read_artefact, read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.showing import Shown
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import KINDS, ArmPoses, Noise, Setup, Term
from suta_calib.terms.poses import joint_ranges
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.patterns import may_read_alike
from suta_calib.units import shown, unit_name
from suta_calib.view.calibrated import Calibrated
from suta_calib.view.calibration import view_calibration

if TYPE_CHECKING:
    from suta_calib.diagnostics.explanation import Explanation
    from suta_calib.diagnostics.repeats import TouchRepeatability
    from suta_calib.plotting.scene import Scene
    from suta_calib.solver.solution import Solution
    from suta_calib.solver.solve import Progress
    from suta_calib.view.calibrated import Calibrated
    from suta_calib.view.server import Viewer

DataSet = Literal["calibration", "validation"]


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationJob(Shown):
    """What a ``calibration.yaml`` asks for, read and checked.

    Attributes:
        spec: the file, typed.
        arm: the arm at nominal.
        parameters: its unknowns.
        observations: terms to fit.
        validation: terms that are never fitted.
        files: what was read for it, itself first.
    """

    spec: JobSpec
    arm: ArmModel
    parameters: ParameterSet
    observations: tuple[Term, ...]
    validation: tuple[Term, ...]
    files: tuple[Path, ...] = ()

    @classmethod
    def load(cls, path: str | Path) -> CalibrationJob:
        """Read a job and everything it names.

        Raises:
            InputError: the first thing that cannot be used: file, line or key, what was found,
                what was expected.
        """
        with inputs_listed() as files:
            job = cls._read(Path(path))
        return replace(job, files=tuple(files))

    @classmethod
    def _read(cls, path: Path) -> CalibrationJob:
        spec = read_job(path)
        arm = spec.arm.model()
        try:
            parameters = arm.select(*spec.parameters)
        except ParameterError as error:
            raise _placed(error, spec.path, error.line) from None
        # What was fitted and what is held out touch the same artefact: it is read once.
        read = partial(read_term, arm, job=spec.path, artefact=cache(read_artefact))
        observations = [read(row, fitted=True) for row in spec.observations]
        _check_once(spec, observations)
        validation = tuple(read(row) for row in spec.validation)
        _check_given_alike(spec, observations, validation)
        terms = (*observations, *validation)
        _check_shared(spec, terms)
        terms = tuple(term.beside(terms) for term in terms)
        fitted = len(observations)
        return cls(spec, arm, parameters, terms[:fitted], terms[fitted:])

    @property
    def in_a_line(self) -> str:
        """Its file, and what it holds."""
        kinds = ", ".join(f"{len(term.poses)} {term.kind}" for term in self.observations)
        held_out = ", ".join(f"{len(term.poses)} {term.kind}" for term in self.validation)
        return (
            f"{self.spec.path.name}, {len(self.parameters)} unknowns from {kinds}; "
            f"held out: {held_out or 'nothing'}"
        )

    def problem(self) -> Problem:
        """The observations as a problem."""
        return Problem(self.observations, self.parameters)

    def options(self) -> SolverOptions:
        """The solver section."""
        s = self.spec.solver
        return SolverOptions(s.starts, s.seed, s.hessian, s.max_iterations)

    def run(
        self, progress: Progress | None = None, about: Callable[[str], None] | None = None
    ) -> Calibration:
        """Solve, validate and judge.

        Args:
            progress: called with (starts done, starts).
            about: called with what is being done, once that is no longer solving.

        Returns:
            The calibration with its `assessment`: whoever shows it computes nothing more.
        """
        began = perf_counter()
        problem = self.problem()
        build = perf_counter() - began
        solution = solve(problem, self.options(), progress)
        solution = replace(solution, timing={"build": build} | solution.timing)
        examined = CalibrationExamination.of(solution, self.validation, self.spec.rule)
        if about is not None:
            # To name what is wrong with data, they are read in many other ways.
            about("judging")
        examined = attempt("judged: ±", lambda: examined.widened, examined)
        result = Calibration(self, examined)
        _ = result.assessment
        return result

    def usable_solution(
        self, progress: Progress | None = None, *, anyway: bool = False
    ) -> Solution:
        """Solve for an analysis that builds on the calibration.

        Args:
            progress: called with (starts done, starts).
            anyway: give what must not be used too, if it converged (``--anyway``).

        Raises:
            SamplesError: it did not converge, so that nothing can be built on it.
            UnusableResultError: its assessment says that it must not be used.
        """
        result = self.run(progress)
        solution = result.solution
        if not solution.converged:
            raise SamplesError(
                f"a calibration that may not be used ({solution.sentence})",
                "one that converged",
                file=self.spec.path,
                hint="run suta-calib calibrate, and mend what it names",
            )
        if not anyway:
            refuse_unusable(result.assessment, self.spec.path)
        return solution


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Shown):
    """A job, its solution, and how far off the arm is before and after.

    Attributes:
        job: what was asked.
        examined: what came out, with all that is computed about it.
    """

    job: CalibrationJob
    examined: CalibrationExamination

    @property
    def solution(self) -> Solution:
        """What came out."""
        return self.examined.solution

    @property
    def accuracy(self) -> Accuracy:
        """Errors of the fitted and of the held-out terms."""
        return self.examined.accuracy

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """Whether the calibrated arm may be used, and what must be known to use it."""
        assessment, failed = assess_calibration(self.examined), list[str]()
        if not self.solution.converged:
            return assessment
        on_the_job = judge("the job's rows", self._on_the_job, failed)
        return assessment.with_care([*on_the_job, *failed])

    @property
    def in_a_line(self) -> str:
        """How far off the arm was and is, and how far to trust it."""
        return f"{self.headline}; {self.assessment.word.lower()}"

    @property
    def headline(self) -> str:
        """``5.60 → 0.93 mm RMS on 1,575 held-out distances``; fitted ones where none are held out.

        Without convergence it says so instead.
        """
        held_out = self.accuracy.validation
        terms = held_out or self.accuracy.calibration
        before, after = (Accuracy.overall(terms, which) for which in ("before", "after"))
        if not self.solution.converged:
            return "not converged"
        first = terms[0].blocks[0]
        # As many decimals as the smaller of the two needs to have two digits.
        figures = [shown(errors.rms, first.unit) for errors in (before, after)]
        least = min((abs(f) for f in figures if f > 0), default=1.0)
        places = min(max(1 - math.floor(math.log10(least)), 0), 6)
        was, now = (f"{figure:.{places}f}" for figure in figures)
        sort = "held-out" if held_out else "fitted"
        what = f"{first.name}{'s' * (after.count != 1)}"
        return f"{was} → {now} {unit_name(first.unit)} RMS on {after.count:,} {sort} {what}"

    def scene(self, data: DataSet | None = None) -> Scene:
        """The arm, what was touched or seen, and errors before and after, to be drawn.

        Args:
            data: ``validation`` or ``calibration``; what is held out, where anything is, by
                default.
        """
        accuracy, job = self.accuracy, self.job
        held_out = accuracy.validation and job.validation
        chosen = data or ("validation" if held_out else "calibration")
        if chosen == "validation":
            if not job.validation:
                raise JobError("no validation data", "some to draw", file=job.spec.path)
            values = accuracy.held_out_nominal, accuracy.held_out_values
            return calibration_scene(job.arm, job.validation, *values)
        values = accuracy.nominal_values, self.solution.values
        return calibration_scene(job.arm, job.observations, *values)

    def plot(self, data: DataSet | None = None, ax: Any = None) -> Any:
        """Draw the arm, what was touched or seen, and magnified errors before and after, mm.

        Args:
            data: as of `scene`.
            ax: `Axes3D` to draw on; those of a new figure by default.

        Returns:
            The `Axes3D`; the legend names the factor by which errors are magnified.
        """
        return plotting.draw_scene(self.scene(data), ax)

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """Why parameters are held; empty where the solution may not be used."""
        return self.examined.explanations

    @property
    def labelled_terms(self) -> dict[str, list[tuple[str, TermAccuracy]]]:
        """The terms of ``calibration`` and ``validation``, with the labels of their job rows."""
        spec, accuracy = self.job.spec, self.accuracy
        sets = {
            "calibration": (spec.observations, accuracy.calibration),
            "validation": (spec.validation if accuracy.validation else (), accuracy.validation),
        }
        return {
            name: [(row.label, term) for row, term in zip(rows, terms, strict=True)]
            for name, (rows, terms) in sets.items()
        }

    @property
    def repeatability(self) -> Mapping[str, tuple[TouchRepeatability, ...]]:
        """How the tip scatters among repeats of the same touch, as ``labelled_terms`` has terms.

        Terms without enough repeats are left out.
        """
        return self.examined.repeatability

    @property
    def calibrated(self) -> Calibrated:
        """What there is to see of it."""
        return Calibrated.of(self.examined, self.assessment, str(self.job.spec.path))

    def view(self, port: int = 0, host: str = "127.0.0.1") -> Viewer:
        """Show it in 3-D, in the browser; in a notebook below the cell.

        Args:
            port: to listen on; 0 for any that is free.
            host: who may look: this computer only; ``0.0.0.0`` lets whoever on the network has the
                address.

        Raises:
            MissingExtraError: the extra ``view`` is not installed.
            OutputError: the port cannot be had.
        """
        return view_calibration(self.calibrated, port, host)

    def _on_the_job(self) -> list[str]:
        """Samples left out by name, held-out ones at fitted rests, or in sockets wide unsaid."""
        spec = self.job.spec
        rows = (*spec.observations, *spec.validation)
        wide = {row.artefact for row in spec.observations if row.seating} - {None}
        notes = [f"The job excludes {row.exclude} from {row.kind}." for row in rows if row.exclude]
        notes += _read_with_fitted(self.job)
        notes += [
            f"The validation row of {row.kind} has no seating, and the observations of the same "
            "artefact do: its errors hold what the seating would take away. Give it the same key."
            for row in spec.validation
            if not row.seating and row.artefact in wide
        ]
        return notes


def read_arm_samples(arm: ArmModel, files: Sequence[Path], kind: str) -> Samples:
    """Samples of an arm for one kind of observation."""
    return read_samples(files, joint_ranges(arm), KINDS[kind].columns)


def read_term(
    arm: ArmModel,
    row: ObservationSpec,
    job: Path,
    *,
    fitted: bool = False,
    artefact: Callable[[Path], Artefact] = read_artefact,
) -> Term:
    """The term of one row of a job, over the arm at nominal, its samples read.

    Args:
        arm: whose readings they are.
        row: the row, checked.
        job: the file it stands in, for messages.
        fitted: whether the samples must be enough to be fitted.
        artefact: reads one.

    Raises:
        InputError: samples or artefact that cannot be used.
    """
    samples = read_arm_samples(arm, row.sample_files, row.kind)
    setup = Setup(
        None if row.artefact is None else artefact(row.artefact),
        _noise(row.sigma_m, row.huber_m, row.sigma_fixed),
        _noise(row.sigma_rad, row.huber_rad, row.sigma_fixed),
        row.label,
        row.seating,
        row.settings,
    )
    try:
        if row.exclude is not None:
            samples = row.exclude.kept(samples)
        term = KINDS[row.kind].over(ArmPoses(arm, samples), setup)
        term = replace(term, given=row.given) if row.given else term
        term = replace(term, scale=row.scale) if row.scale else term
        term.check_given()
        if fitted:
            term.check_enough()
    except InputError as error:
        raise _placed(error, job, row.line) from None
    for note in term.notes:
        warnings.warn(f"{job}:{row.line}: {note}", SutaCalibWarning, stacklevel=3)
    return term


def _given_unknowns(terms: Sequence[Term]) -> dict[str, Parameter]:
    """Own unknowns of which a given pose says something."""
    return {p.name: p for term in terms if term.given for p in term.unknowns if p not in term.own}


def _check_given_alike(
    spec: JobSpec, observations: Sequence[Term], validation: Sequence[Term]
) -> None:
    """Refuse a pose of a held-out row that would go unheard: what is fitted keeps its place."""
    fitted = {p.name for term in observations for p in term.own}
    given = _given_unknowns(observations)
    for row, term in zip(spec.validation, validation, strict=True):
        for name, parameter in _given_unknowns([term]).items():
            if name in fitted and given.get(name) != parameter:
                raise JobError(
                    f"a given pose that differs from that of the observations in {name}",
                    "one pose for one place",
                    file=spec.path,
                    line=row.line,
                    hint="give it in the row of the observations; or give what stands elsewhere "
                    "another label",
                )


def _check_shared(spec: JobSpec, terms: Sequence[Term]) -> None:
    """Refuse rows that share a camera or a board, and say two things of it."""
    rows = (*spec.observations, *spec.validation)
    for k, (row, term) in enumerate(zip(rows, terms, strict=True)):
        for before in terms[:k]:
            try:
                term.check_beside(before)
            except SamplesError as error:
                raise _placed(error, spec.path, row.line) from None


def _check_once(spec: JobSpec, terms: Sequence[Term]) -> None:
    """Refuse rows of a job that are one another's samples: they would count twice."""
    if len(terms) < 2:
        return

    rows_by_kind: dict[str, list[tuple[int, set[bytes]]]] = {}
    for k, (row, term) in enumerate(zip(spec.observations, terms, strict=True)):
        keys = set(term.poses.samples.as_keys())
        for other, theirs in rows_by_kind.setdefault(row.kind, []):
            both = len(keys & theirs)
            # Touches of one point may happen to read alike, a few of them, by coarse encoders.
            few = max(1, min(len(keys), len(theirs)) // 2)
            if both > (few if may_read_alike(term.poses.samples) else 1):
                raise JobError(
                    f"{both} samples that stand in observations[{other}] too",
                    "samples of their own in every row of one kind",
                    file=spec.path,
                    line=row.line,
                    where=f"observations[{k}].samples",
                    hint="name every file once, by one path",
                )
        rows_by_kind[row.kind].append((k, keys))


def _read_with_fitted(job: CalibrationJob) -> list[str]:
    """Held-out rows that are other readings of a fitted rest (equal ones: `contradictions`)."""
    beside = read_where_fitted(job.observations, job.validation)
    beside &= ~fitted_too(job.observations, job.validation)
    # Share of the validation rows that were read where fitted ones were: fewer hardly change an
    # RMS.
    not_held_out = 0.1
    if not len(beside) or beside.mean() < not_held_out:
        return []
    return [
        f"{int(beside.sum())} of {len(beside)} validation rows were read where fitted ones were, "
        "without moving or back there: what the model gets wrong at those postures they do not "
        "show."
    ]


def _placed(error: InputError, job: Path, line: int | None) -> InputError:
    """The same error with a place in the job, for what was found without knowing of files."""
    return error if error.file is not None else JobError.of(error, job, line)


def _noise(sigma: float | None, huber: float | None, fixed: bool) -> Noise:
    return Noise(sigma, math.inf if huber is None else huber, fixed and sigma is not None)
