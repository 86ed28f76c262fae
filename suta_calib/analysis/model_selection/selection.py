"""Which errors beside geometry an arm should be given: those that predict what was not fitted.

More unknowns always fit better; they are worth having if placements that were left out are
predicted better (`cross_validation`). A model outdoes another if its held-out error is smaller by
more than one standard error of the difference over the folds (the one-standard-error rule, paired;
Breiman et al. 1984, section 3.4.3), by 2 % of the variance at least, and in four of five folds. The
best of many that are tried is lucky: unless the residuals alone prove it (`residual_tests`:
suspicious, or p below 5 % for all tests together), it needs three standard errors.

The search goes forward, one joint and family at a time, from the job's unknowns and from all of
the geometry. A bent link can look like an eccentric encoder, so what is added to the job's unknowns
must also outdo the geometry.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from suta_calib.analysis.model_selection.cross_validation import (
    Fold,
    ModelCandidate,
    cross_validate,
    fitted_rms,
    folds_of,
    limited_rms,
)
from suta_calib.assessment import Assessment
from suta_calib.diagnostics.accuracy import assess
from suta_calib.diagnostics.assessment import assess_calibration
from suta_calib.diagnostics.score_tests import ScoreTest, offered_names, score_tests
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import PLAUSIBLE, Family, ParameterSet, Selection
from suta_calib.solver.ipopt import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import Progress, solve
from suta_calib.terms import Term
from suta_calib.threads import single_threaded
from suta_calib.units import text
from suta_calib.words import listed

# Joints and families tried at each step, most suspicious first, and what is suspicious at all.
TRIED: Final = 3
SUSPICIOUS: Final = 0.1
MOST_STEPS: Final = 6
# Chance, for all tests, below which the residuals prove a term; standard errors it needs otherwise.
PROVEN: Final = 0.05
UNPROVEN: Final = 3.0

EVERY_JOINT: Final[dict[tuple[Family, ...], str]] = {
    ("ecc_1",): "first harmonic, all joints",
    ("ecc_1", "ecc_2"): "both harmonics, all joints",
    ("compliance",): "compliance, all joints",
    ("ecc_1", "ecc_2", "compliance"): "harmonics and compliance, all joints",
}
SHORT: Final[dict[Family, str]] = {
    "ecc_1": "first harmonic",
    "ecc_2": "second harmonic",
    "compliance": "compliance",
}
# Models that a search usually fits: only to say how far it has come.
EXPECTED: Final = 12


@dataclass(frozen=True, eq=False)
class ModelSelection:
    """What was tried, and what is worth having.

    Attributes:
        tried: in the order they were tried; the first is the job's own model.
        chosen: one of them.
        folds: what was left out each time.
        tests: of the residuals of the job's own model.
        undecided: whether something beside geometry helps, but geometry helps as much.
        calibration: whether the chosen model's calibration may be used.
        validated: Huber-limited RMS on data that took no part in the choice, m, with the job's
            model and with the chosen one; None without such data.
    """

    tried: tuple[ModelCandidate, ...]
    chosen: ModelCandidate
    folds: tuple[str, ...]
    tests: tuple[ScoreTest, ...]
    undecided: bool
    calibration: Assessment
    validated: tuple[float, float] | None = None

    @property
    def job(self) -> ModelCandidate:
        """The job's own model."""
        return self.tried[0]

    @property
    def added(self) -> tuple[str, ...]:
        """The parameters beside geometry that are worth having, beyond what the job has."""
        return tuple(n for n in self.chosen.added if n not in self.job.added)

    @property
    def rows(self) -> tuple[Selection, ...]:
        """What to add to the job's ``parameters``."""
        rows: list[Selection] = []
        if self.chosen.geometry and not self.job.geometry:
            rows += geometry_rows()
        return (*rows, *_rows(self.chosen.solution.problem.arm, self.added))

    @property
    def assessment(self) -> Assessment:
        """Whether anything should be added to the job, and what must be known."""
        before, after = (
            text(each.held_out.rms, "m", with_unit=True) for each in (self.job, self.chosen)
        )
        gain = f"held-out RMS {before} → {after}"
        wider = self.chosen.geometry and not self.job.geometry
        if self.added:
            more = "all of the geometry, " if wider else ""
            sentence = f"Add {more}{listed(self.added)}: {gain}"
        elif wider:
            sentence = f"Free all of the geometry: {gain}; nothing beside geometry is worth having"
        else:
            sentence = (
                "No error beside geometry predicts left-out data better: leave the job as it is"
            )
        fitted = self.calibration
        why = next(iter(fitted.notes), fitted.sentence).rstrip(".")
        bad = f"The calibration with this model must not be used ({why}): mend that first."
        return Assessment.of(sentence, bad=[] if fitted.usable else [bad], care=self._notes())

    def _notes(self) -> list[str]:
        notes = []
        if self.chosen is not self.job:
            notes.append("The rows given here, put into the job's parameters, make it so.")
        if self.added:
            notes.append(
                "A URDF cannot hold these: calibrated.urdf will be the geometry only, and its tip "
                "is right only with the corrections of result.json (track --result applies them)."
            )
        if self.undecided:
            notes.append(
                "Something beside the job's unknowns helps, but these data cannot tell whether it "
                "is geometry or an error beside it: tilt the artefact, use other heights, or touch "
                "one point from many directions."
            )
        estimates = self.chosen.solution.estimates
        if bounded := [name for name in self.added if estimates[name].state == "at_bound"]:
            notes.append(f"{listed(bounded)} ended at a bound: larger than is plausible.")
        return notes


def geometry_rows() -> tuple[Selection, Selection]:
    """Rows that free all of the geometry, within what is plausible."""
    placements = Selection(("geometric",), PLAUSIBLE["m"], PLAUSIBLE["rad"])
    return placements, Selection(("*.offset",), bound_rad=PLAUSIBLE["rad"])


@single_threaded
def choose_model(
    terms: Sequence[Term],
    parameters: ParameterSet,
    *,
    validation: Sequence[Term] = (),
    families: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
) -> ModelSelection:
    """Search for errors beside geometry that predict left-out placements better.

    Args:
        terms: the observations, validation data not among them.
        parameters: the arm's unknowns as the job has them.
        validation: held-out terms that take no part in the choice: it is judged on them.
        families: also try every joint at once: both harmonics, compliance, everything.
        seed: of the folds where there are no placements.
        progress: called with (models fitted, models at most).

    Raises:
        ParameterError: no arm with a revolute joint.
        SamplesError: too few samples to leave any out, or a job that cannot be fitted without them.
    """
    search = _Search(tuple(terms), parameters, folds_of(terms, seed), progress)
    job = search.candidate("as the job has it", geometry=False, added=_added(parameters))
    if job is None:
        raise SamplesError(
            "observations that cannot be fitted once a placement is left out",
            "enough placements for the job's unknowns",
            where="observations",
            hint="measure at more placements, or select fewer parameters",
        )
    wide = search.candidate("all of the geometry", geometry=True, added=job.added)
    ends = [search.grown(job, wide)]
    ends += [search.grown(wide)] if wide is not None else []
    chosen, undecided = _better_end(job, wide, ends)
    if families:
        chosen = search.whole_families(chosen, job if not chosen.geometry else wide or job)
    labels = tuple(fold.label for fold in search.folds)
    accuracy = assess(chosen.solution, validation)
    calibration = assess_calibration(chosen.solution, accuracy)
    validated = None
    if validation:
        before = assess(job.solution, validation).validation
        validated = limited_rms(before), limited_rms(accuracy.validation)
    tests = score_tests(job.solution)
    tried = tuple(search.tried)
    return ModelSelection(tried, chosen, labels, tests, undecided, calibration, validated)


def _better_end(
    job: ModelCandidate, wide: ModelCandidate | None, ends: Sequence[ModelCandidate]
) -> tuple[ModelCandidate, bool]:
    """Of the two ends of the search, and whether geometry would explain the narrow one as well."""
    narrow = ends[0]
    if wide is None:
        return narrow, False
    if ends[1].outdoes(narrow):
        return ends[1], False
    gain, error = narrow.gain_over(wide)
    if narrow is job or gain > error:
        return narrow, False
    return (ends[1] if ends[1].outdoes(job) else job), True


@dataclass(eq=False)
class _Search:
    """Fits and cross-validates what it is asked to, once."""

    terms: tuple[Term, ...]
    parameters: ParameterSet
    folds: tuple[Fold, ...]
    progress: Progress | None
    tried: list[ModelCandidate] = field(default_factory=list)
    _noise: tuple[float, ...] = ()

    @property
    def arm(self) -> ArmModel:
        arm = Problem(self.terms, self.parameters).arm
        if arm is None or all(p.unit != "rad" for p in arm.nongeometric.values()):
            raise ParameterError("no arm with a revolute joint", "one", where="observations")
        return arm

    def candidate(
        self, name: str, *, geometry: bool, added: Iterable[str]
    ) -> ModelCandidate | None:
        """A model; None where it cannot be fitted or has nothing new."""
        added = tuple(added)
        arm = self.arm
        chosen = dict(arm.select(*geometry_rows())) if geometry else {}
        rows = _rows(arm, added)
        chosen |= dict(arm.select(*rows)) if rows else {}
        chosen |= dict(self.parameters)
        unknown = ParameterSet(chosen[n] for n in arm.offered if n in chosen)
        new = len(added) - len(_added(self.parameters))
        if geometry and len(unknown) == len(self.parameters) + new:
            return None
        try:
            solution = solve(Problem(self.terms, unknown), SolverOptions(starts=1))
        except SamplesError:
            return None
        self._noise = self._noise or solution.noise
        held_out = cross_validate(self.folds, unknown, self._noise) if solution.converged else None
        if held_out is None:
            return None
        found = ModelCandidate(name, geometry, added, solution, fitted_rms(solution), held_out)
        self.tried.append(found)
        if self.progress is not None:
            self.progress(len(self.tried), max(len(self.tried) + 1, EXPECTED))
        return found

    def grown(self, start: ModelCandidate, rival: ModelCandidate | None = None) -> ModelCandidate:
        """Forward from a start for as long as something outdoes what there is.

        A first step that a rival outdoes is the last: another start leads farther.
        """
        current = start
        for _ in range(MOST_STEPS):
            if current is not start and rival is not None and rival.outdoes(current):
                break
            better = []
            tests = [t for t in score_tests(current.solution) if t.p_single < SUSPICIOUS]
            for test in tests[:TRIED]:
                name = f"{test.joint} {SHORT[test.family]}"
                if current.added == _added(self.parameters):
                    name = _with_geometry(name, current.geometry)
                else:
                    name = f"{current.name} + {name}"
                names = dict.fromkeys((*current.added, *test.names))
                found = self.candidate(name, geometry=current.geometry, added=names)
                errors = 1.0 if test.suspicious or test.p < PROVEN else UNPROVEN
                if found is not None and found.outdoes(current, errors):
                    better.append(found)
            if not better:
                break
            current = min(better, key=lambda c: c.held_out.loss)
        return current

    def whole_families(self, chosen: ModelCandidate, base: ModelCandidate) -> ModelCandidate:
        """Every joint at once, for comparison; taken only if that outdoes all else."""
        for families, name in EVERY_JOINT.items():
            offered = offered_names(self.arm).items()
            names = [n for (_, family), own in offered if family in families for n in own]
            wanted = tuple(dict.fromkeys((*base.added, *names)))
            if len(wanted) == len(base.added):
                continue
            found = self.candidate(
                _with_geometry(name, base.geometry), geometry=base.geometry, added=wanted
            )
            if found is not None and found.outdoes(chosen, UNPROVEN):
                chosen = found
        return chosen


def _added(parameters: ParameterSet) -> tuple[str, ...]:
    return tuple(name for name, p in parameters.items() if not p.geometric)


def _with_geometry(name: str, geometry: bool) -> str:
    return f"all of the geometry + {name}" if geometry else name


def _rows(arm: ArmModel | None, names: Sequence[str]) -> tuple[Selection, ...]:
    """Rows that select these, within what is plausible: eccentricities, compliances, gains."""
    assert arm is not None
    rows = []
    for unit in ("rad", "rad/Nm", "1"):
        if own := tuple(n for n in names if arm.offered[n].unit == unit):
            plausible = arm.offered[own[0]].plausible
            row = Selection(
                own,
                bound_rad=plausible if unit == "rad" else None,
                bound_rad_per_nm=plausible if unit == "rad/Nm" else None,
                bound_ratio=plausible if unit == "1" else None,
            )
            rows.append(row)
    return tuple(rows)
