"""A job file brought to life: the arm, its unknowns, the terms, and the run."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from time import perf_counter
from typing import Any, Final, Literal

from suta_calib import plotting
from suta_calib.arm_keys import ArmSpec, ChainSpec
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, attempt, judge, judged, refuse_unusable
from suta_calib.atomic import inputs_listed
from suta_calib.display import Displayable, named
from suta_calib.errors import InputError, JobError, ParameterError, SamplesError, SutaCalibWarning
from suta_calib.job.in_python import IN_PYTHON, Free, row_of, terms_over, unknowns_of
from suta_calib.job.job_terms import held_together, placed, read_term
from suta_calib.job.scene import calibration_scene
from suta_calib.job.schema import JobSpec, read_job
from suta_calib.measurements import read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import (
    GEOMETRIC,
    ParameterSet,
)
from suta_calib.model.robot import Robot
from suta_calib.plotting.scene import Scene
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.robot_bases import with_bases_found
from suta_calib.solver.sensor_mounts import over_mounted, with_sensors_mounted
from suta_calib.solver.solution import Estimate, Solution
from suta_calib.solver.solve import Progress, solve
from suta_calib.terms import Term
from suta_calib.trust.accuracy import (
    Accuracy,
    Metrics,
    TermAccuracy,
    fitted_too,
    read_where_fitted,
)
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.explanation import Explanation
from suta_calib.trust.repeats import TouchRepeatability
from suta_calib.units import shown, unit_name
from suta_calib.view.calibrated import Calibrated
from suta_calib.view.calibration import view_calibration
from suta_calib.view.server import Viewer

DataSet = Literal["calibration", "validation"]
# Who writes an answer as a page, and is made of answers.
_PAGES: Final = "suta_calib.report.notebook"
# Who checks it later, and is made of trust.
_CHECKER: Final = "suta_calib.check"


def _with_what_is_held_out(spec: JobSpec) -> JobSpec:
    """Without rows of validation whose folder is empty; the assessment says what that means."""
    there = tuple(row for row in spec.validation if row.sample_files)
    for row in spec.validation:
        if row not in there:
            patterns = ", ".join(row.samples)
            message = f"{spec.path}:{row.line}: found no validation data ({patterns}): the folder "
            message += "is empty. Put samples there that the fit never sees"
            warnings.warn(message, SutaCalibWarning, stacklevel=4)
    return replace(spec, validation=there)


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationJob(Displayable):
    """What a ``calibration.yaml`` asks for, read and checked.

    Attributes:
        spec: the file, typed.
        arm: the arm at nominal, or the robot with its chains.
        parameters: its unknowns.
        observations: terms to fit.
        validation: terms that are never fitted.
        files: what was read for it, itself first; none of a job that stands in no file.
        chosen: how to solve, where that stands in no file.
    """

    spec: JobSpec
    arm: ArmModel | Robot
    parameters: ParameterSet
    observations: tuple[Term, ...]
    validation: tuple[Term, ...]
    files: tuple[Path, ...] = ()
    chosen: SolverOptions | None = None

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
        spec = _with_what_is_held_out(read_job(path))
        arm = spec.arm.mechanism(spec.pairs)
        try:
            parameters = arm.select(*spec.parameters)
            arm.check_masses_felt(parameters)
        except ParameterError as error:
            raise placed(error, spec.path, error.line) from None
        # What was fitted and what is held out touch the same artefact: it is read once.
        read = partial(read_term, arm, job=spec.path, artefact=cache(read_artefact))
        observations = [read(row, fitted=True) for row in spec.observations]
        validation = [read(row) for row in spec.validation]
        terms = held_together(spec, observations, validation)
        if arm.tilt_sensors:
            arm = with_sensors_mounted(arm, terms[0])
            terms = over_mounted(arm, terms[0]), over_mounted(arm, terms[1])
            parameters = arm.select(*spec.parameters)
        return cls(spec, arm, with_bases_found(terms[0], parameters), *terms)

    @classmethod
    def of_terms(
        cls,
        arm: ArmModel | Robot,
        observations: Term | Sequence[Term],
        validation: Term | Sequence[Term] = (),
        *,
        free: Free = GEOMETRIC,
        options: SolverOptions = SolverOptions(),
    ) -> CalibrationJob:
        """A job that was put together in Python, and stands in no file.

        Args:
            arm: at nominal; or a robot.
            observations: terms to fit, over this arm or over chains of the robot.
            validation: terms that are never fitted, likewise.
            free: what is unknown: names, globs and `Selection`s, as one row each of a job, later
                ones win; ``geometric`` alone means all placements and joint offsets. What has
                neither bounds nor a prior gets the prior that is usual (`with_usual_priors`). Or
                parameters as `ArmModel.select` gives them, which stay as they are.
            options: how to solve.

        Raises:
            InputError: terms of another arm, too few samples, or unknowns that the arm lacks.
        """
        fitted = terms_over(arm, "terms", observations)
        held_out = terms_over(arm, "validation", validation)
        if not fitted:
            raise InputError("no observations", "at least one term to fit", where="calibrate")
        for term in fitted:
            term.check_enough()
            for note in term.notes:
                warnings.warn(f"{term.kind}: {note}", SutaCalibWarning, stacklevel=3)
        rows, parameters = unknowns_of(arm, free)
        if not isinstance(options, SolverOptions):
            raise InputError(repr(options), "SolverOptions(…)", where="calibrate: options")
        spec = JobSpec(
            IN_PYTHON,
            _spec_of(arm),
            rows,
            tuple(map(row_of, fitted)),
            tuple(map(row_of, held_out)),
        )
        terms = held_together(spec, fitted, held_out)
        if arm.tilt_sensors:
            arm = with_sensors_mounted(arm, terms[0])
            terms = over_mounted(arm, terms[0]), over_mounted(arm, terms[1])
            _, parameters = unknowns_of(arm, free)
        parameters = with_bases_found(terms[0], parameters)
        return cls(spec, arm, parameters, *terms, chosen=options)

    @property
    def title(self) -> str:
        """What is calibrated: the name of the job's folder, or the robot's."""
        path = self.spec.path
        return path.parent.resolve().name or path.name if self.files else self.arm.robot

    @property
    def in_a_line(self) -> str:
        """Its file, and what it holds."""
        kinds = ", ".join(f"{len(term.poses)} {term.kind}" for term in self.observations)
        held_out = ", ".join(f"{len(term.poses)} {term.kind}" for term in self.validation)
        return (
            f"{self.spec.path.name}, {len(self.parameters)} unknowns from {kinds}; "
            f"validation: {held_out or 'nothing'}"
        )

    def problem(self) -> Problem:
        """The observations as a problem."""
        return Problem(self.observations, self.parameters)

    def options(self) -> SolverOptions:
        """What was chosen, or the solver section."""
        s = self.spec.solver
        return self.chosen or SolverOptions(s.starts, s.seed, s.hessian, s.max_iterations)

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
                hint="run suta-calib calibrate, and correct what its notes name",
            )
        if not anyway:
            refuse_unusable(result.assessment, self.spec.path)
        return solution


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Displayable):
    """What came out of a calibration, judged: the one answer of a job and of `calibrate`.

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
    def estimates(self) -> dict[str, Estimate]:
        """Every unknown by name, with its standard deviation; the arm's come first."""
        return self.solution.estimates

    @property
    def covariance(self) -> FloatArray:
        """(n, n) of `estimates`, in their order, m and rad; zero where nothing was estimated."""
        return self.solution.covariance

    @property
    def metrics(self) -> dict[str, dict[str, Metrics]]:
        """``metrics["validation"]["after"].rms``: of lengths, m, with the nominal arm and after.

        Of all terms of the first one's kind, as in ``result.json``; without validation data there
        is only ``calibration``.
        """
        sets = {"calibration": self.accuracy.calibration, "validation": self.accuracy.validation}
        return {
            name: {which: Accuracy.overall(terms, which) for which in ("before", "after")}
            for name, terms in sets.items()
            if terms
        }

    @cached_property
    def arm(self) -> ArmModel | Robot:
        """The calibrated arm, with what a URDF cannot hold; the nominal one is ``job.arm``."""
        return self.job.arm.at(self.solution.values)

    def write_urdf(self, path: str | Path, *, anyway: bool = False) -> None:
        """Write the user's own URDF with the calibrated values in the origins of its joints.

        Args:
            path: of the new file.
            anyway: write what must not be used too.

        Raises:
            UnusableResultError: the assessment says that the result must not be used.
            OutputError: the file cannot be written; nothing is left half-written.
        """
        refuse_unusable(self.assessment, Path(path), anyway=anyway, insist="anyway=True")
        self.job.arm.write_urdf(path, self.solution.values)

    def report(self, path: str | Path) -> None:
        """Write ``report.html`` of it: one page that needs nothing else.

        Args:
            path: of the new file.

        Raises:
            OutputError: the file cannot be written.
        """
        named(_PAGES, "write_page")(self, Path(path))

    @property
    def in_a_line(self) -> str:
        """How far off the arm was and is, and how far to trust it."""
        return f"{self.headline}; {self.assessment.word.lower()}"

    @property
    def headline(self) -> str:
        """``5.60 → 0.93 mm RMS on 1,575 validation distances``; fitted ones without any.

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
        sort = "validation" if held_out else "fitted"
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
                raise JobError("no validation data", "validation data to draw", file=job.spec.path)
            values = accuracy.held_out_nominal, accuracy.held_out_values
            return calibration_scene(job.arm, job.validation, *values)
        values = accuracy.nominal_values, self.solution.values
        return calibration_scene(job.arm, job.observations, *values)

    def check(self, terms: Term | Sequence[Term], *, false_alarm: float = 0.01) -> Any:
        """Whether this calibration still holds for new rows, and what changed if not.

        Args:
            terms: new rows, over the same arm, of kinds that were calibrated.
            false_alarm: probability that sound rows are said to show a change.

        Returns:
            A `suta_calib.check.Check`; its ``assessment`` says it in a sentence.

        Raises:
            UnusableResultError: this calibration must not be used.
            InputError: rows of another arm, or of a kind that was not calibrated.
        """
        refuse_unusable(self.assessment, self.job.spec.path)
        return named(_CHECKER, "Checker")(self.solution).check(terms, false_alarm)

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
        title = str(self.job.spec.path) if self.job.files else self.job.title
        return Calibrated.of(self.examined, self.assessment, title)

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
            f"The validation row of {row.kind} has no seating, but the observations of the same "
            "artefact have it: the validation errors include the seating error. Write the same key "
            "seating there."
            for row in spec.validation
            if not row.seating and row.artefact in wide
        ]
        return notes


def _spec_of(arm: ArmModel | Robot) -> ArmSpec:
    """What a job's file would say of an arm."""
    if isinstance(arm, ArmModel):
        return ArmSpec(arm.chain.path, arm.tip, arm.chain.base)
    ends = {name: ChainSpec(c.tip, c.chain.base) for name, c in arm.chains.items()}
    return ArmSpec(arm.urdf[0], chains=ends)


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
        f"{int(beside.sum())} of {len(beside)} validation rows were read in the posture of a "
        "fitted row, without moving in between. They do not show the errors of the model in other "
        "postures."
    ]
