"""Chooses errors beside the geometry to estimate: those that improve left-out predictions.

More unknowns always fit better; they are worth having if placements that were left out are
predicted better, or stretches of a recording in motion (`cross_validation`). A model outdoes
another if its held-out error is smaller by more than one standard error of the difference over the
folds (the one-standard-error rule, paired; Breiman et al. 1984, section 3.4.3), by 2 % of the
variance at least, and in four of five folds. The best of many that are tried is lucky: unless the
residuals alone prove it (`score_tests`: suspicious, or one of its two p below 5 % for all tests
together), it needs three standard errors.

The search goes forward, from the job's unknowns and from all of the geometry, for as long as
anything outdoes what there is: one joint and family at a time, or a family of all joints at once,
because many small errors that are each lost in the noise add up. Among what gains alike the
smallest is taken, and at the end goes what predicts no worse without it. A bent link can look like
an eccentric encoder, so what is added to the job's unknowns must also outdo the geometry.

Each start is fitted and linearised once; what the search tries costs milliseconds. What it chooses
is fitted anew, and cross-validated about its own fit.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from suta_calib.analysis.model_selection.gear_search import FoundRatio, found_ratios
from suta_calib.arguments import checked
from suta_calib.assessment import Assessment, judged
from suta_calib.display import Displayable
from suta_calib.errors import ParameterError, SamplesError
from suta_calib.model.parameters import (
    BACKLASH,
    COUPLING,
    DECAY,
    GEAR_RATIO,
    HYSTERESIS,
    PLAUSIBLE,
    RIPPLE,
    Family,
    ParameterSet,
    Selection,
)
from suta_calib.model.robot import AnyArm, same_chain
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.solve import Progress, solve
from suta_calib.terms import ArmPoses, Term
from suta_calib.threads import single_threaded
from suta_calib.trust.assessment import assess_calibration
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.cross_validation import Fold, ModelCandidate, folds_of, limited_rms
from suta_calib.trust.extended_problem import causes, offered_names, recorded
from suta_calib.trust.linearised import LinearModels, ModelFit
from suta_calib.trust.score_tests import Residuals, ScoreTest
from suta_calib.units import Unit, text
from suta_calib.words import listed

# Chance, for all tests, below which the residuals prove a term; standard errors it needs otherwise.
# By touch or by variance: where 75 touches are tested for dozens of errors, the first alone misses
# three of 20 eccentric encoders beside geometry that is off. Held-out errors must agree: of 100
# sound sets at most five are given anything.
PROVEN: Final = 0.05
UNPROVEN: Final = 3.0

# What may be given to all joints at once.
EVERY_JOINT: Final[dict[tuple[Family, ...], str]] = {
    ("ecc_1",): "first harmonic, all joints",
    ("ecc_2",): "second harmonic, all joints",
    ("ecc_1", "ecc_2"): "both harmonics, all joints",
    ("compliance",): "compliance, all joints",
    ("bending",): "bending, all joints",
    ("compliance", "bending"): "compliance and bending, all joints",
    ("gain",): "gain, all joints",
    ("backlash",): "backlash, all joints",
    ("ecc_1", "ecc_2", "compliance"): "harmonics and compliance, all joints",
}
# The same in recordings in motion, which tell where each joint came from.
IN_MOTION: Final[dict[tuple[Family, ...], str]] = {
    ("hysteresis",): "hysteresis, all joints",
    ("backlash", "hysteresis"): "backlash and hysteresis, all joints",
    ("coupling",): "couplings of neighbours, all joints",
    ("cable",): "cables of neighbours, all joints",
    ("coupling", "cable"): "couplings and cables of neighbours, all joints",
}
SHORT: Final[dict[Family, str]] = {
    "ecc_1": "first harmonic",
    "ecc_2": "second harmonic",
    "cable": "cables of a neighbour",
}
# How a row of parameters says what is plausible, by its unit.
BOUNDS: Final[dict[Unit, str]] = {
    "m": "bound_m",
    "rad": "bound_rad",
    "rad/Nm": "bound_rad_per_nm",
    "kg": "bound_kg",
    "1/K": "bound_per_k",
    "1": "bound_ratio",
}


@dataclass(frozen=True, eq=False)
class ModelSelection(Displayable):
    """The models that were tried, and the chosen one.

    Attributes:
        tried: in the order they were tried; the first is the job's own model.
        chosen: one of them.
        folds: what was left out each time.
        tests: of the residuals of the job's own model.
        undecided: whether something beside geometry helps, but geometry helps as much.
        solution: of the chosen model, fitted to all observations.
        calibration: whether that may be used.
        validated: Huber-limited RMS on data that took no part in the choice, m, with the job's
            model and with the chosen one; None without such data.
        gears: ratios that were found, of the joints whose ripple was added.
    """

    tried: tuple[ModelCandidate, ...]
    chosen: ModelCandidate
    folds: tuple[str, ...]
    tests: tuple[ScoreTest, ...]
    undecided: bool
    solution: Solution
    calibration: Assessment
    validated: tuple[float, float] | None = None
    gears: tuple[FoundRatio, ...] = ()

    @property
    def unit(self) -> Unit:
        """Unit of the errors."""
        return self.solution.problem.terms[0].error_unit

    @property
    def job(self) -> ModelCandidate:
        """The job's own model."""
        return self.tried[0]

    @property
    def added(self) -> tuple[str, ...]:
        """Parameters beside the geometry that the chosen model has and the job does not."""
        return tuple(n for n in self.chosen.added if n not in self.job.added)

    @property
    def confirmed(self) -> bool:
        """Whether the validation rows, where there are any, err less with the chosen model too."""
        if self.validated is None or self.chosen is self.job:
            return True
        return self.validated[1] < self.validated[0]

    @property
    def rows(self) -> tuple[Selection, ...]:
        """What to add to the job's ``parameters``; nothing that validation rows do not confirm."""
        if not self.confirmed:
            return ()
        wider = self.chosen.geometry and not self.job.geometry
        return (*(geometry_rows() if wider else ()), *_rows(self.solution.problem.arm, self.added))

    @property
    @judged
    def assessment(self) -> Assessment:
        """Whether to add anything to the job, with notes."""
        before, after = (
            text(candidate.held_out.rms, self.unit, with_unit=True)
            for candidate in (self.job, self.chosen)
        )
        gain = f"validation RMS {before} → {after}"
        wider = self.chosen.geometry and not self.job.geometry
        if self.validated and not self.confirmed:
            worse, better = (text(rms, self.unit, with_unit=True) for rms in self.validated[::-1])
            sentence = (
                "Keep the job as it is: more unknowns reduce the error of rows left out of the "
                f"fit ({gain}), but not the error of the validation rows ({better} → {worse})"
            )
        elif self.added:
            more = "all of the geometry, " if wider else ""
            sentence = f"Add {more}{listed(self.added)}: {gain}"
        elif wider:
            sentence = (
                f"Estimate all of the geometry: {gain}. No other error improves the prediction"
            )
        else:
            sentence = (
                "Keep the job as it is: no additional error improves the prediction of left-out "
                "data"
            )
        fitted = self.calibration
        why = next(iter(fitted.notes), fitted.sentence).rstrip(".")
        bad = f"Do not use the calibration with this model ({why}). Correct that first."
        return Assessment.of(sentence, bad=[] if fitted.usable else [bad], care=self._notes())

    def _notes(self) -> list[str]:
        notes: list[str] = []
        if not self.confirmed:
            return notes
        if self.chosen is not self.job:
            notes.append("To use this model, add the rows shown here to the parameters of the job.")
        if self.added:
            notes.append(
                "A URDF cannot hold these parameters. calibrated.urdf will contain only the "
                "geometry; the tip is correct only with the corrections of result.json, which "
                "track --result applies."
            )
        for gear in self.gears:
            also = f" ({listed([*map(str, gear.others)], 8)} fit as well)" if gear.others else ""
            notes.append(
                f"The gear ratio of {gear.joint} was found in the residuals: {gear.ratio}{also}. "
                f"The chance of such a ripple without one is {gear.chance:.1g}, for all joints and "
                "ratios that were looked at. State the ratio in the job with the rows: arm: "
                f"{{gear_ratios: {{{gear.joint}: {gear.ratio}}}}}. Check it in the data sheet."
            )
        if self.undecided:
            notes.append(
                "More parameters reduce the errors, but these data do not show whether the cause "
                "is the geometry or another error. Tilt the artefact, use other heights, or "
                "touch one point from many directions."
            )
        estimates = self.solution.estimates
        if bounded := [name for name in self.added if estimates[name].state == "at_bound"]:
            notes.append(
                f"{listed(bounded)} ended at a bound: the value is larger than is plausible."
            )
        return notes


def geometry_rows() -> tuple[Selection, Selection]:
    """Rows that free all of the geometry, within what is plausible."""
    placements = Selection(("geometric",), PLAUSIBLE["m"], PLAUSIBLE["rad"])
    return placements, Selection(("*.offset",), bound_rad=PLAUSIBLE["rad"])


@single_threaded
@checked
def choose_model(
    terms: Sequence[Term],
    parameters: ParameterSet,
    *,
    validation: Sequence[Term] = (),
    families: bool = True,
    seed: int = 0,
    progress: Progress | None = None,
) -> ModelSelection:
    """Search for errors beside the geometry that improve the prediction of left-out placements.

    Args:
        terms: the observations, validation data not among them.
        parameters: the arm's unknowns as the job has them.
        validation: held-out terms that take no part in the choice: it is judged on them.
        families: also try every joint at once: harmonics, compliance, gain.
        seed: of the folds where there are no placements.
        progress: called with (models fitted, models at most).

    Raises:
        ParameterError: no arm with a revolute joint.
        SamplesError: too few samples to leave any out, or a job that cannot be fitted without them.
    """
    terms, validation = tuple(terms), tuple(validation)
    choice = _choose(terms, parameters, validation, families, seed, progress)
    arm = choice.solution.problem.arm
    gears = found_ratios(CalibrationExamination.of(choice.solution))
    if arm is None or not gears:
        return choice
    # Residuals show them; left-out data must confirm them as they do anything else.
    geared = arm.at({f"{gear.joint}.{GEAR_RATIO}": float(gear.ratio) for gear in gears})
    of_geared = [_of_arm(part, geared) for part in (terms, validation)]
    again = _choose(of_geared[0], parameters, of_geared[1], families, seed, progress)
    used = tuple(g for g in gears if {f"{g.joint}.{key}" for key in RIPPLE} & {*again.added})
    return replace(again, gears=used) if used else choice


def _of_arm(terms: Sequence[Term], arm: AnyArm) -> tuple[Term, ...]:
    """The terms over the same chains of an arm with other nominal values."""
    return tuple(
        term.over_poses(term.poses.of_arm(same_chain(term.poses.arm, arm)))
        if isinstance(term.poses, ArmPoses)
        else term
        for term in terms
    )


def _choose(
    terms: tuple[Term, ...],
    parameters: ParameterSet,
    validation: tuple[Term, ...],
    families: bool,
    seed: int,
    progress: Progress | None,
) -> ModelSelection:
    """The search, with the gears that the arm has."""
    search = _ExtensionSearch(terms, parameters, folds_of(terms, seed), families, progress)
    job = search.start("as the job has it", geometry=False)
    if job is None:
        raise SamplesError(
            "too few observations to estimate the job's parameters",
            "enough placements for the job's unknowns",
            where="observations",
            hint="measure at more placements, or select fewer parameters",
        )
    wide = search.start("all of the geometry", geometry=True)
    refitted = None
    while refitted is None:
        ends = [search.grown(job, wide), *([] if wide is None else [search.grown(wide)])]
        best, undecided = _better_end(job, wide, ends)
        refitted = search.refitted(best, wide if best.geometry and wide else job)
    chosen, solution = refitted
    labels = tuple(fold.label for fold in search.folds)
    examined = CalibrationExamination.of(solution, validation)
    calibration = assess_calibration(examined)
    started = CalibrationExamination.of(search.solutions[job.name], validation)
    validated = None
    if validation:
        before, after = (limited_rms(e.accuracy.validation) for e in (started, examined))
        validated = before, after
    tests = started.score_tests
    tried = tuple(search.tried.values())
    return ModelSelection(tried, chosen, labels, tests, undecided, solution, calibration, validated)


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


@dataclass(frozen=True)
class _Extension:
    """What may be added to a model, and how much better it must be, in standard errors."""

    name: str
    names: tuple[str, ...]
    errors: float


@dataclass(eq=False)
class _ExtensionSearch:
    """Tries what it is asked to, once."""

    terms: tuple[Term, ...]
    parameters: ParameterSet
    folds: tuple[Fold, ...]
    families: bool
    progress: Progress | None
    tried: dict[str, ModelCandidate] = field(default_factory=dict)  # by the name of the model
    # Of what was fitted as such, likewise.
    solutions: dict[str, Solution] = field(default_factory=dict)
    # Names that seemed useful but that a fit could not determine.
    untold: set[str] = field(default_factory=set)
    _linearised: dict[bool, LinearModels] = field(default_factory=dict)
    _noise: tuple[float, ...] = ()

    @property
    def arm(self) -> AnyArm:
        arm = Problem(self.terms, self.parameters).arm
        if arm is None or all(p.unit != "rad" for p in arm.nongeometric.values()):
            raise ParameterError("no arm with a revolute joint", "one", where="observations")
        return arm

    @property
    def _recorded(self) -> bool:
        return recorded(self.terms)

    @property
    def offered(self) -> dict[tuple[str, Family], tuple[str, ...]]:
        """What the arm can be given, by joint and family."""
        return offered_names(self.arm, in_motion=self._recorded)

    def start(self, name: str, *, geometry: bool) -> ModelCandidate | None:
        """One of the two starts, fitted; None if it cannot be, or has no unknown more."""
        unknown = self._unknown(geometry, ())
        if geometry and len(unknown) == len(self.parameters):
            return None
        solution = self._fitted(unknown)
        if solution is None:
            return None
        self._noise = self._noise or solution.noise
        self.solutions[name] = solution
        examined = CalibrationExamination.of(solution)
        linear = self._linearised[geometry] = LinearModels(examined, self.folds, self._noise)
        return self._noted(self._candidate(name, geometry, linear, linear.fit()))

    def grown(self, start: ModelCandidate, rival: ModelCandidate | None = None) -> ModelCandidate:
        """Forward from a start for as long as something outdoes what there is.

        A first step that a rival outdoes is the last: another start leads farther.
        """
        linear, current = self._linearised[start.geometry], start
        while current is start or rival is None or not rival.outdoes(current):
            more = [n for n in current.added if n not in start.added]
            better = []
            for step in self._steps(linear.residuals(linear.fit(more))):
                base = current.name if more else "all of the geometry" if start.geometry else ""
                name = " + ".join(filter(None, [base, step.name]))
                fit = linear.fit((*more, *step.names))
                candidate = self._noted(self._candidate(name, start.geometry, linear, fit))
                if candidate.outdoes(current, step.errors):
                    better.append(candidate)
            if not better:
                break
            # The smallest of those that are as good as the best.
            best = min(better, key=lambda c: c.held_out.loss)
            as_good = [c for c in better if c is best or not best.outdoes(c)]
            current = min(as_good, key=lambda c: (len(c.added), c.held_out.loss))
        return self._pruned(current, start)

    def _pruned(self, end: ModelCandidate, start: ModelCandidate) -> ModelCandidate:
        """The end of a search without what it predicts no worse without: a block brings idle parts.

        The name stays that of the search's last step unless something goes.
        """
        linear, current = self._linearised[start.geometry], end
        groups = [
            set(parts)
            for (_, family), names in self.offered.items()
            for parts in causes(family, names)
        ]
        while True:
            more = [n for n in current.added if n not in start.added]
            fewer = [[n for n in more if n not in group] for group in groups]
            tried = [
                self._candidate("", start.geometry, linear, linear.fit(names))
                for names in fewer
                if 0 < len(names) < len(more)
            ]
            best = min(tried, key=lambda c: c.held_out.loss, default=current)
            if best.held_out.loss >= current.held_out.loss:
                break
            current = replace(best, name=f"{end.name}, pruned")
        return current if current is end else self._noted(current)

    def refitted(
        self, chosen: ModelCandidate, start: ModelCandidate
    ) -> tuple[ModelCandidate, Solution] | None:
        """The model with its errors about its own fit; the start where it cannot be fitted.

        Returns:
            None where the fit cannot tell some of its names: what they kept from being chosen may
            be worth having, so the search must be gone through again without them.
        """
        if chosen.name in self.solutions:
            return chosen, self.solutions[chosen.name]
        # On what way a joint's friction builds up no model that is linear about none can say.
        fading = self._decays(chosen.added)
        new = [n for n in (*chosen.added, *fading) if n not in start.added]
        solution = self._fitted(self._unknown(chosen.geometry, (*chosen.added, *fading)))
        if solution is None:
            # Play is hardly told from friction beside it, and corners of the cost keep steps from
            # settling: without it, then with the ways of friction as they usually are.
            play = [n for n in new if self.arm.offered[n].key == BACKLASH]
            self.untold |= {*(play or fading)}
            if play:
                del self.tried[chosen.name]
                return None
            return self.refitted(chosen, start) if fading else (start, self.solutions[start.name])
        estimates = solution.estimates
        if untold := {n for n in new if estimates[n].std is None}:
            self.untold |= untold
            if untold <= {*fading}:
                return self.refitted(chosen, start)
            del self.tried[chosen.name]
            return None
        self.solutions[chosen.name] = solution
        linear = LinearModels(CalibrationExamination.of(solution), self.folds, self._noise)
        base = self._candidate(chosen.name, chosen.geometry, linear, linear.fit())
        return self._noted(base), solution

    def _decays(self, added: Iterable[str]) -> list[str]:
        """Of the joints whose hysteresis is among these names; those that a fit could not tell."""
        offered = self.arm.offered
        owners = [offered[n].owner for n in added if offered[n].key == HYSTERESIS]
        return [n for n in (f"{owner}.{DECAY}" for owner in owners) if n not in self.untold]

    def _steps(self, left: Residuals) -> Iterator[_Extension]:
        """What the residuals of a model make worth a try."""
        # Joints and families tried at each step, most suspicious first, and what is suspicious at
        # all.
        tried = 6
        suspicious = 0.1
        tests = left.tests()
        suspects = [t for t in tests if t.p_single < suspicious and not self.untold & {*t.names}]
        for test in suspects[:tried]:
            proven = test.suspicious or min(test.p, test.p_variance) < PROVEN
            # There are two for each pair of neighbours: of 12 sound sets one was given a coupling
            # that the residuals do not prove.
            if test.family in (COUPLING, "cable") and not proven:
                continue
            name = f"{test.joint} {SHORT.get(test.family, test.family)}"
            yield _Extension(name, test.names, 1.0 if proven else UNPROVEN)
        if not self.families:
            return
        offered, at_once = self.offered, EVERY_JOINT | (IN_MOTION if self._recorded else {})
        for families, name in at_once.items():
            tellable = left.telling_names(
                n
                for (_, f), names_of_joint in offered.items()
                if f in families
                for n in names_of_joint
            )
            names = tuple(n for n in tellable if n not in self.untold)
            joints = {n for test in tests for n in test.names} & set(names)
            if len(joints) > 2:
                p = (len(tests) + len(at_once)) * left.chance(names)
                yield _Extension(name, names, 1.0 if p < PROVEN else UNPROVEN)

    def _noted(self, candidate: ModelCandidate) -> ModelCandidate:
        self.tried[candidate.name] = candidate
        if self.progress is not None:
            # Models that a search usually tries: only to say how far it has come.
            self.progress(len(self.tried), max(len(self.tried) + 1, 30))
        return candidate

    def _candidate(
        self, name: str, geometry: bool, linear: LinearModels, fit: ModelFit
    ) -> ModelCandidate:
        added = _added(linear.solution.problem.arm_parameters)
        parameters = self._unknown(geometry, (*added, *fit.added))
        errors = linear.rms(fit), linear.cross_validation(fit)
        return ModelCandidate(name, geometry, _added(parameters), parameters, *errors)

    def _unknown(self, geometry: bool, added: Iterable[str]) -> ParameterSet:
        """The arm's unknowns: the job's, and what is added within what is plausible."""
        arm, rows = self.arm, _rows(self.arm, tuple(added))
        rows = (*(geometry_rows() if geometry else ()), *rows)
        chosen = {**(arm.select(*rows) if rows else {}), **self.parameters}
        return ParameterSet(chosen[n] for n in arm.offered if n in chosen)

    def _fitted(self, unknown: ParameterSet) -> Solution | None:
        try:
            solution = solve(Problem(self.terms, unknown), SolverOptions(confirm=False))
        except SamplesError:
            return None
        return solution if solution.converged else None


def _added(parameters: ParameterSet) -> tuple[str, ...]:
    return tuple(name for name, p in parameters.items() if not p.geometric)


def _rows(arm: AnyArm | None, names: Sequence[str]) -> tuple[Selection, ...]:
    """Rows that select these, within what is plausible: one for each size of it."""
    assert arm is not None
    rows, order = [], [*BOUNDS]
    by_bound = defaultdict[tuple[Unit, float], list[str]](list)
    for name in names:
        by_bound[arm.offered[name].unit, arm.offered[name].plausible].append(name)
    for (unit, plausible), of_unit in sorted(
        by_bound.items(), key=lambda row: order.index(row[0][0])
    ):
        bound: dict[str, Any] = {BOUNDS[unit]: plausible}
        rows.append(Selection(tuple(of_unit), **bound))
    return tuple(rows)
