"""A check: does everything that was calibrated still hold for new rows, and if not, what changed?

New rows have, at the calibrated parameters, residuals r whose covariance is known if nothing
changed (`error_model`). Freed of it they are a `LinearFit`, whose unknowns are what the rows alone
must tell (where an artefact stands now). Everything that may have changed is an effect beside it
(`suspects`), weighed by the one test of `trust.evidence` with the noise of the calibration, and all
of them together have one false-alarm rate (`family`). What explains the rows best, for its few
numbers, is named (Schwarz 1978, doi:10.1214/aos/1176344136), the parameters are moved by it, and
what is left is asked again. A row that alone explains them better is a bad row, and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtri

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import Assessment, judged
from suta_calib.check.changed import ChangedParameters
from suta_calib.check.error_model import LearnedErrors
from suta_calib.check.family import Family
from suta_calib.check.new_rows import NewRows
from suta_calib.check.reference import reference_of
from suta_calib.check.suspects import PLAUSIBLE, Suspect, candidates_of, suspect_of, suspects_of
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.solver.artefact_and_scale import artefact_errors
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.threads import single_threaded
from suta_calib.trust.evidence import Effect, Evidence, weigh_effects
from suta_calib.trust.examination import Examination
from suta_calib.trust.held_out import sort_of
from suta_calib.trust.linear_fit import LinearFit
from suta_calib.units import Unit, text, with_std
from suta_calib.words import enumerated, listed

FALSE_ALARM: Final = 0.01
# Changes that a few rows can tell from each other.
_MOST_CHANGES: Final = 3
# Share of the samples that may be bad; samples below which none is told from a change.
_MOST_BAD: Final = 0.25
_FEWEST: Final = 4
UNKNOWN: Final = "something else"
BESIDE_HELD: Final = (
    "The calibration holds dimensions that its own rows show to be wrong. These are no change: the "
    "new rows were held against what the calibrated rows say of all dimensions. Estimate them "
    "(select: geometric, with prior_mm and prior_deg)."
)
# What most often changes, and is said of what the rows would have shown.
_FIRST: Final = ("base", "instrument", "camera", "board", "tip")


@dataclass(frozen=True, eq=False)
class FoundChange(Displayable):
    """What changed since the calibration.

    Attributes:
        what: ``base``, ``tip``, ``instrument``, ``camera``, ``board``, ``placement``, ``joint
            NAME``, ``link NAME``, ``scale``, or `UNKNOWN` where the rows agree with no single one.
        amounts: by how much, and the standard deviation of that, by unit, SI.
        p: chance of rows so far off if nothing changed, allowing for all tests.
        instead: what explains the rows nearly as well.
        names: parameters that describe it; empty where none do.
        directions: (k, r) of the names in which these rows tell something, one σ along each.
        at_tip: by how much it moves the tips of these rows, RMS, m; NaN where they do not move.
        since: file and row at which it began; empty where all rows show it.
    """

    what: str
    amounts: Mapping[Unit, tuple[float, float]]
    p: float
    instead: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    directions: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    at_tip: float = math.nan
    since: str = ""

    @property
    def amount(self) -> str:
        """``1.02 ± 0.08 mm and 0.10 ± 0.03°``."""
        return enumerated([with_std(*amount, unit) for unit, amount in self.amounts.items()])

    @property
    def implausible(self) -> bool:
        """Whether it is larger than anything that happens unnoticed."""
        return any(
            abs(by) > PLAUSIBLE.get(unit, math.inf) for unit, (by, _) in self.amounts.items()
        )

    @property
    def sentence(self) -> str:
        """What changed by how much, and what cannot be told from it."""
        if self.what == UNKNOWN:
            return (
                "The rows do not agree with the calibration, and no single change over all of them "
                "explains them. "
                "They may be of another arm or another result. Check that; else calibrate again."
            )
        moved = (
            ""
            if math.isnan(self.at_tip)
            else f": {text(self.at_tip, 'm', with_unit=True)} at the tip"
        )
        the = f"From {self.since} on: the" if self.since else "The"
        first = f"{the} {said(self.what)} changed by {self.amount}{moved}."
        if self.implausible:
            first += (
                " Nothing changes by so much unnoticed: look for another unit (samples are in m "
                "and rad; a device may give mm), another arm or another result."
            )
        if not self.instead:
            return first
        others = enumerated([said(name) for name in self.instead], "or")
        return f"{first} These rows cannot tell it from a change of the {others}."


@dataclass(frozen=True, eq=False)
class FoundPower(Displayable):
    """What change these rows would have shown.

    Attributes:
        what: as of `FoundChange`.
        amounts: found with the probability `POWER` wherever it points, by unit; inf where one in
            some direction does not show.
    """

    what: str
    amounts: Mapping[Unit, float]


@dataclass(frozen=True, eq=False)
class Check(Displayable):
    """The answer of a check.

    Attributes:
        changed: what changed, most certain first.
        power: what these rows would have shown.
        bad_rows: rows that agree neither with the calibration nor with any change, by file and row.
        bad_samples: numbers of these.
        p: chance of rows so far off if nothing changed.
        rows: how many there are.
        false_alarm: rate that was asked for.
        values: of all parameters of the rows, with what changed.
        notes: what must be known of it.
        first: number of the sample from which on something changed.
        beside_held: whether the calibration holds dimensions that its own rows show to be wrong.
        before, after: RMS of the errors of each term's first block, m or rad, with the calibration
            as it was, and with what changed.
    """

    changed: tuple[FoundChange, ...]
    power: tuple[FoundPower, ...]
    bad_rows: tuple[str, ...]
    p: float
    rows: int
    false_alarm: float
    values: Mapping[str, float]
    notes: tuple[str, ...] = ()
    bad_samples: tuple[int, ...] = ()
    before: tuple[tuple[str, float, Unit], ...] = ()
    after: tuple[tuple[str, float, Unit], ...] = ()
    first: int = 0
    beside_held: bool = False

    @property
    def unchanged(self) -> bool:
        """Whether nothing changed that these rows would show."""
        return not self.changed

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """``bad`` where something changed: the calibration must not be used as it is."""
        if self.changed:
            what = enumerated([said(change.what) for change in self.changed])
            return Assessment.of(
                f"{what} changed since the calibration",
                bad=[change.sentence for change in self.changed],
                care=self._care,
                facts=[BESIDE_HELD] * self.beside_held,
            )
        return Assessment.of(
            "nothing changed that these rows would show", care=self._care, facts=self._facts
        )

    @property
    def _care(self) -> list[str]:
        notes = [*self.notes]
        if self.bad_rows:
            notes.append(
                f"{listed(self.bad_rows)} agree{'s' * (len(self.bad_rows) == 1)} with nothing else "
                "and was left out: a bad row, no change. Measure it again."
            )
        return notes

    @property
    def _facts(self) -> list[str]:
        shown = [p for p in self.power if all(map(math.isfinite, p.amounts.values()))]
        joints = [p for p in shown if p.what.startswith("joint ")]
        # The one that shows least stands for all.
        least = sorted(joints, key=lambda p: -max(p.amounts.values()))[:1]
        others = [p for p in shown if p.what in _FIRST]
        facts = [
            f"These rows would have shown the {said(p.what)} off by "
            f"{enumerated([text(a, unit, with_unit=True) for unit, a in p.amounts.items()], 'or')}."
            for p in (*least, *others)
        ]
        return [*facts, *self._hidden, *[BESIDE_HELD] * self.beside_held]

    @property
    def _hidden(self) -> Iterator[str]:
        """What may have changed and would not have shown."""
        named = [p for p in self.power if p.what.startswith("joint ") or p.what in _FIRST]
        never = [p for p in named if not any(map(math.isfinite, p.amounts.values()))]
        if never:
            yield f"These rows cannot show a change of the {listed([said(p.what) for p in never])}."
        some = [p for p in named if p not in never]
        motions: dict[Unit, str] = {"m": "shift", "rad": "turn"}
        for unit, motion in motions.items():
            partly = [p.what for p in some if math.isinf(p.amounts.get(unit, 0.0))]
            if partly:
                yield f"These rows cannot show every {motion} of the {listed(partly)}."
        if self.rows < _FEWEST:
            few = "1 row proves" if self.rows == 1 else f"{self.rows} rows prove"
            yield (
                f"{few} little: a change that shows at other postures only is not seen. Measure "
                f"{_FEWEST} rows or more, far apart."
            )


def said(what: str) -> str:
    """What changed as a sentence calls it: of a joint it is the zero."""
    return what.replace("joint ", "zero of ", 1) if what.startswith("joint ") else what


@dataclass(frozen=True, eq=False)
class Checker(Displayable):
    """A calibration that new rows are held against.

    Attributes:
        solution: of the calibration (`reference_of` it, where that lacks dimensions).
        known: values of its parameters now, where some were estimated again (`check.repair`).
        covariance: names of the estimates then (n,), and their covariance now (n, n).
    """

    solution: Solution
    known: Mapping[str, float] | None = None
    covariance: tuple[tuple[str, ...], FloatArray] | None = None

    @cached_property
    def reference(self) -> Solution:
        """What new rows are held against: the calibration, but for dimensions that it lacks."""
        return reference_of(self.solution) if self.known is None else self.solution

    @cached_property
    def errors(self) -> LearnedErrors:
        """Of the calibrated rows."""
        return LearnedErrors.of(self.reference)

    @property
    def values(self) -> Mapping[str, float]:
        """Of all parameters of the reference, now."""
        return self.reference.values if self.known is None else self.known

    @cached_property
    def estimated(self) -> tuple[tuple[str, ...], FloatArray]:
        """Names of the estimates (n,), and their covariance (n, n) but for the scale's part."""
        if self.covariance is not None:
            return self.covariance
        reference, free = self.reference, self.reference.free
        names = tuple(reference.problem.names[k] for k in free)
        covariance = reference.covariance_within_scale[np.ix_(free, free)]
        at = [names.index(name) for name in self.errors.names]
        by_errors = np.zeros_like(covariance)
        by_errors[np.ix_(at, at)] = self.errors.of_estimates
        return names, _larger(covariance, by_errors)

    def scale_seen_by(self, terms: Sequence[Term]) -> FloatArray | None:
        """(n, n) of the reference's parameters, by a scale that new rows do not share; or None."""
        reference = self.reference
        seen = reference.covariance_seen_by(terms) - reference.covariance_within_scale
        return seen if np.any(seen) else None

    def check(self, terms: Term | Sequence[Term], false_alarm: float = FALSE_ALARM) -> Check:
        """Hold new rows against the calibration: `checking`, and what it finds."""
        return self.checking(terms, false_alarm).run()

    def checking(self, terms: Term | Sequence[Term], false_alarm: float = FALSE_ALARM) -> Checking:
        """Hold new rows against the calibration.

        Args:
            terms: over the same arm, of kinds that were calibrated.
            false_alarm: probability that sound rows are said to show a change.

        Raises:
            InputError: rows of another arm, or of a kind that was not calibrated.
        """
        every = [terms] if isinstance(terms, Term) else list(terms)
        self._check_kinds(every)
        return Checking(self, self.rows(every, self.reference, self.values), false_alarm)

    def rows(
        self, terms: Sequence[Term], solution: Solution, values: Mapping[str, float]
    ) -> NewRows:
        """New rows at values of a solution's parameters."""
        answer = Examination.of_poses(solution)
        return NewRows.beside(answer, terms, values, self.errors.levels)

    def _check_kinds(self, terms: Sequence[Term]) -> None:
        known = {sort[0] for sort in self.errors.levels}
        for term in terms:
            if any(sort_of(term, block) not in self.errors.levels for block in term.blocks):
                raise SamplesError(
                    f"rows of {term.kind}",
                    f"rows of a kind that was calibrated: {enumerated(sorted(known), 'or')}",
                    where="check",
                )


@dataclass(frozen=True, eq=False)
class Checking:
    """One check on its way.

    Attributes:
        checker: what new rows are held against.
        start: the rows at the calibrated values.
        false_alarm: rate.
        of_one_kind: (m, m) covariance of the rows by one kind of noise; None for all kinds.
    """

    checker: Checker
    start: NewRows
    false_alarm: float
    of_one_kind: FloatArray | None = None

    @cached_property
    def by_estimates(self) -> FloatArray:
        """(m, m) covariance by what the calibration does not know, certified places included."""
        estimated, covariance = self.checker.estimated
        jacobian = self._columns(estimated)
        total = jacobian @ covariance @ jacobian.T
        if (scale := self.checker.scale_seen_by(self.start.problem.terms)) is not None:
            jacobian = self._columns(self.checker.reference.problem.names)
            total = total + jacobian @ scale @ jacobian.T
        certified = artefact_errors(self.start.rows)
        if certified is not None:
            shift = self.start.shared.combine(np.vstack(certified.jacobian)) * certified.sigma
            total = total + shift @ shift.T
        return np.asarray(total)

    def _columns(self, names: Sequence[str]) -> FloatArray:
        """(m, n) derivative by parameters by name; zero by those that these rows do not have."""
        place = {name: k for k, name in enumerate(self.start.problem.names)}
        columns = np.zeros((len(self.start.residual), len(names)))
        for k, name in enumerate(names):
            if name in place:
                columns[:, k] = self.start.jacobian[:, place[name]]
        return columns

    @cached_property
    def by_noise(self) -> list[FloatArray]:
        """(m, m) for each kind of noise."""
        return self.checker.errors.covariances(
            self.start.shared, self.start.jacobian, self.start.problem.names
        )

    @cached_property
    def total(self) -> FloatArray:
        """(m, m) covariance of the rows, on average over the kinds of noise."""
        if self.of_one_kind is not None:
            return self.of_one_kind
        kinds = self.checker.errors.kinds
        noise = sum(kind.weight * v for kind, v in zip(kinds, self.by_noise, strict=True))
        return np.asarray(noise + self.by_estimates)

    @cached_property
    def own(self) -> IntArray:
        """Parameters that only these rows tell."""
        known = self.checker.values
        problem = self.start.problem
        return np.array(
            [
                k
                for k, p in enumerate(problem.parameters.values())
                if k >= problem.arm_count and p.free and p.name not in known
            ],
            dtype=np.intp,
        )

    @cached_property
    def root(self) -> FloatArray:
        """(m, m) of `total`, lower."""
        return np.asarray(np.linalg.cholesky(self.total), dtype=float)

    def white(self, columns: FloatArray) -> FloatArray:
        """(m, …) columns of the rows, freed of their covariance."""
        freed = solve_triangular(self.root, columns, lower=True, check_finite=False)
        return np.asarray(freed)

    def fit(
        self, rows: NewRows, freed: ChangedParameters | None = None, extra: FloatArray | None = None
    ) -> LinearFit:
        """The rows freed of their covariance.

        Args:
            rows: where they are linear.
            freed: what changed, which follows beside what is the rows' own.
            extra: (m, j) what else they may have, such as a bad row.
        """
        freed = ChangedParameters() if freed is None else freed
        extra = np.zeros((len(rows.residual), 0)) if extra is None else extra
        both = [
            rows.jacobian[:, self.own],
            freed.columns(rows.jacobian),
            extra,
            rows.residual[:, None],
        ]
        white = self.white(np.hstack(both))
        more = np.zeros(freed.count + extra.shape[1])
        own = rows.problem.prior_precision()[self.own]
        away = rows.x[self.own] - rows.problem.parameters.array("nominal")[self.own]
        return LinearFit(
            white[:, :-1],
            white[:, -1],
            np.concatenate([own, more]),
            np.concatenate([away, more]),
            noise_freedom=self.checker.errors.freedom,
        )

    @single_threaded
    def run(self) -> Check:
        """What changed, in all rows or from one of them on."""
        check, explained, left = self._over_all()
        # One change or one bad row explains itself; several bad rows may be a change at the end.
        several = len(check.changed) > 1 or len(check.bad_rows) > 1
        if not several and all(change.what != UNKNOWN for change in check.changed):
            return check
        since = self._since(check, explained)
        if since is not None:
            return since
        if check.unchanged or not left or any(change.implausible for change in check.changed):
            return check
        # What leaves the rows far beyond their noise is not what changed.
        unknown = FoundChange(UNKNOWN, {}, check.p)
        return replace(check, changed=(unknown,), bad_rows=(), bad_samples=(), after=check.before)

    def split(self, first: int) -> tuple[Checking, Checking]:
        """Checks of the samples before one, and from it on."""
        before, after = list[Term](), list[Term]()
        for term in self.start.problem.terms:
            count = len(term.poses)
            here = min(max(first, 0), count)
            before += [term.take(np.arange(here))] if here else []
            after += [term.take(np.arange(here, count))] if here < count else []
            first -= count
        return (
            self.checker.checking(before, self.false_alarm),
            self.checker.checking(after, self.false_alarm),
        )

    def _since(self, check: Check, explained: float) -> Check | None:
        """A change that began at one of the rows, if that explains more than one over all rows.

        It is looked for where all rows show a change or several are bad, and must be certain by the
        rows from there on alone. Its p-values are of the best of all places where it may begin.
        """
        onsets = np.arange(1, len(self.start.shared.posture) - 1)
        if len(self.start.shared.sample) > 1 or not len(onsets):
            return None
        # So many are weighed within a second; between two of them it is looked at more closely.
        step = -(-len(onsets) // 64)
        first, criterion = self._best_onset(onsets[::step], len(onsets))
        if step > 1:
            near = onsets[np.abs(onsets - first) < step]
            first, criterion = self._best_onset(near, len(onsets))
        if criterion <= explained:
            return None
        before, after = self.split(first)
        (sound, *_), (found, *_) = before._over_all(), after._over_all()
        if not sound.unchanged or found.unchanged or found.changed[0].what == UNKNOWN:
            return None
        origin = [row for t in self.start.problem.terms for row in t.poses.samples.origin]
        changed = [
            replace(c, since=origin[first], p=min(1.0, c.p * len(onsets))) for c in found.changed
        ]
        # Beside an alarm of all rows it is an explanation; beside bad rows it is the alarm.
        if check.unchanged and changed[0].p >= self.false_alarm:
            return None
        return replace(
            check,
            changed=tuple(changed),
            p=min(check.p, changed[0].p),
            bad_rows=(*sound.bad_rows, *found.bad_rows),
            bad_samples=(*sound.bad_samples, *(first + k for k in found.bad_samples)),
            values=found.values,
            before=found.before,
            after=found.after,
            first=first,
        )

    def _best_onset(self, onsets: IntArray, tried: int) -> tuple[int, float]:
        """Sample from which on some change explains most, and by Schwarz's criterion how much."""
        sample, log_choices = self.start.shared.sample[0], math.log(tried)
        suspects = suspects_of(self.start, self.checker.values)
        fit, best = self.fit(self.start), (0, -math.inf)
        for onset in onsets.tolist():
            later = (sample >= onset)[:, None]
            begun = [replace(s, columns=s.columns * later) for s in suspects]
            effects = [replace(e, log_choices=log_choices) for e in self.effects(begun)]
            for evidence in weigh_effects(fit, effects)[:1]:
                best = max(best, (onset, evidence.criterion(fit.rows)), key=lambda one: one[1])
        return best

    def _over_all(self) -> tuple[Check, float, bool]:
        """What changed in all rows alike; how much that explains, and whether too much is left.

        The first by Schwarz's criterion.
        """
        rows, freed = self.start, ChangedParameters()
        extra, bad, changes = np.zeros((len(rows.residual), 0)), list[int](), list[FoundChange]()
        fit = self.fit(rows, freed, extra)
        squares = fit.squares
        candidates = candidates_of(rows, self.checker.values)
        evidence = weigh_effects(fit, self.effects(candidates))
        kinds = zip(self.checker.errors.kinds, self.by_noise, strict=True)
        white = [(kind.weight, kind.freedom, self._freed(v)) for kind, v in kinds]
        every = rows.shared.of_samples
        every = None if every is None else self.white(every)
        known = self._freed(self.by_estimates)
        family = Family.of(fit, evidence, white, known, every, self.false_alarm)
        found = {e.effect.name: e for e in evidence}
        power = tuple(_power(s, fit, found.get(s.what), family) for s in candidates)
        while True:
            if not changes:
                p = min([family.p_of_all(fit), *(family.p_value(e.p_single) for e in evidence)])
            certain = [e for e in evidence if family.p_value(e.p_single) < self.false_alarm]
            row = self._bad_row(fit, bad, certain)
            if row is not None:
                bad.append(row)
                extra = np.hstack([extra, self.start.shared.of_sample(row)])
            elif certain and len(changes) < _MOST_CHANGES:
                changes.append(_change(certain, family, rows))
                suspect = suspect_of(certain[0])
                if suspect.names:
                    at = [rows.problem.names.index(name) for name in suspect.names]
                    freed = freed.beside(at, changes[-1].directions)
                    rows = self._settled(rows, freed, extra)
                else:
                    extra = np.hstack([extra, suspect.columns])
            else:
                break
            fit = self.fit(rows, freed, extra)
            chosen = {change.what for change in changes}
            suspects = [s for s in suspects_of(rows, self.checker.values) if s.what not in chosen]
            evidence = weigh_effects(fit, self.effects(suspects))
        if not changes and family.p_of_all(fit) < self.false_alarm:
            changes.append(FoundChange(UNKNOWN, {}, family.p_of_all(fit)))
        origin = [row for t in self.start.problem.terms for row in t.poses.samples.origin]
        penalty = (freed.count + extra.shape[1]) * math.log(max(fit.rows, 2.0))
        check = Check(
            tuple(changes),
            power,
            tuple(origin[k] for k in bad),
            p,
            len(origin),
            self.false_alarm,
            rows.values,
            bad_samples=tuple(bad),
            before=self._errors_at(self.start),
            after=self._errors_at(rows),
            beside_held=self.checker.reference is not self.checker.solution,
        )
        left = family.p_of_all(fit) < self.false_alarm
        return check, squares - fit.squares - penalty, left

    @cached_property
    def _as_calibrated(self) -> NewRows:
        """The rows at the calibration's own values."""
        checker = self.checker
        if checker.reference is checker.solution:
            return self.start
        return checker.rows(self.start.problem.terms, checker.solution, checker.solution.values)

    def _errors_at(self, rows: NewRows) -> tuple[tuple[str, float, Unit], ...]:
        """Errors with the calibration's own values, but for what moved in these rows."""
        checker, before = self.checker, self._as_calibrated
        known = checker.solution.values if checker.known is None else checker.known
        moved = {
            name: before.values[name] + by
            for name, by in zip(rows.problem.names, (rows.x - self.start.x).tolist(), strict=True)
            if by and (name in known or name in rows.problem.arm_parameters)
        }
        if not moved:
            return _errors_of(before)
        terms = before.problem.terms
        return _errors_of(checker.rows(terms, checker.solution, {**known, **moved}))

    def _freed(self, covariance: FloatArray) -> FloatArray:
        """(m, m) a covariance of the rows, freed of their total one."""
        return self.white(self.white(covariance).T)

    def effects(self, suspects: Sequence[Suspect]) -> list[Effect]:
        """On the rows freed of their covariance."""
        if not suspects:
            return []
        ends = np.cumsum([suspect.columns.shape[1] for suspect in suspects])
        white = np.split(self.white(np.hstack([s.columns for s in suspects])), ends[:-1], axis=1)
        return [replace(s.effect, columns=c) for s, c in zip(suspects, white, strict=True)]

    def _settled(self, rows: NewRows, freed: ChangedParameters, extra: FloatArray) -> NewRows:
        """The rows where what changed, and what they alone tell, has been moved to fit them."""
        own = len(self.own)
        # A change that is no small one is found in a few steps.
        for _ in range(6):
            fit = self.fit(rows, freed, extra)
            at = rows.x.copy()
            at[self.own] += fit.step[:own]
            np.add.at(at, freed.at, freed.along @ fit.step[own : own + freed.count])
            rows = rows.moved_to(at)
            # Of a step, in whitened units, that changes nothing.
            if float(np.linalg.norm(fit.jacobian @ fit.step)) < 1e-3:
                break
        return rows

    def _bad_row(
        self, fit: LinearFit, bad: Sequence[int], certain: Sequence[Evidence]
    ) -> int | None:
        """A sample that alone explains more, for its few numbers, than any change."""
        shared = self.start.shared
        count = len(shared.posture)
        if count < _FEWEST or len(bad) + 1 > max(_MOST_BAD * count, 1.0):
            return None
        columns = {k: shared.of_sample(k) for k in range(count) if k not in bad}
        effects = [Effect(str(k), self.white(c), about=k) for k, c in columns.items() if c.size]
        evidence = weigh_effects(fit, effects)
        if not evidence or evidence[0].p_single * len(effects) >= self.false_alarm:
            return None
        best = evidence[0]
        if certain and certain[0].criterion(fit.rows) >= best.criterion(fit.rows):
            return None
        sample: int = best.effect.about
        return sample


def _change(certain: Sequence[Evidence], family: Family, rows: NewRows) -> FoundChange:
    """The best of some, and what explains nearly as much."""
    best, suspect = certain[0], suspect_of(certain[0])
    # By how much less than the best a suspect may explain that explains as much: chance of two
    # numbers.
    alike = [suspect_of(e).what for e in certain[1:] if e.gain > best.gain - float(chdtri(2, 0.01))]
    values, vectors = np.linalg.eigh(best.covariance)
    told = values > 1e-12 * values[-1]
    # A link holds its joint's zero.
    own_link = suspect.what.replace("joint ", "link ", 1)
    return FoundChange(
        suspect.what,
        suspect.amounts(best.size, best.covariance),
        family.p_value(best.p_single),
        tuple(name for name in alike if name != own_link),
        suspect.names,
        (vectors * np.sqrt(np.maximum(values, 0.0)))[:, told],
        _at_tip(suspect, best, rows),
    )


def _larger(one: FloatArray, other: FloatArray) -> FloatArray:
    """(n, n) a covariance, with what another one has beyond it."""
    unit = np.sqrt(np.maximum(np.diag(one) + np.diag(other), 1e-300))
    more = (other - one) / np.outer(unit, unit)
    values, vectors = np.linalg.eigh((more + more.T) / 2.0)
    added = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.asarray(one + added * np.outer(unit, unit))


def _power(
    suspect: Suspect, fit: LinearFit, evidence: Evidence | None, family: Family
) -> FoundPower:
    """The smallest changes, wherever they point, that these rows would have shown."""
    if evidence is None:
        return FoundPower(suspect.what, dict.fromkeys(suspect.units, math.inf))
    curvature = fit.curvature(evidence.effect.columns)
    # Probability with which a change of the size of `Power` is found.
    least = family.seen(evidence.rank, 0.9)
    if suspect.motion is not None:
        back = np.linalg.pinv(suspect.motion)
        curvature = back.T @ curvature @ back
    amounts = dict[Unit, float]()
    for unit, part in suspect.parts:
        weakest = float(np.linalg.eigvalsh(curvature[np.ix_(part, part)])[0])
        strongest = float(np.max(np.diag(curvature)[part]))
        # Of the strongest direction, what is rounding.
        shown = math.sqrt(least / weakest) if weakest > 1e-9 * strongest else math.inf
        amounts[unit] = shown if shown < PLAUSIBLE.get(unit, math.inf) else math.inf
    return FoundPower(suspect.what, amounts)


def _at_tip(suspect: Suspect, evidence: Evidence, rows: NewRows) -> float:
    """RMS by which the tips of the rows move with a change of the arm, m; NaN of another one."""
    arm = rows.problem.arm_parameters
    if not suspect.names or not all(name in arm for name in suspect.names):
        return math.nan
    at = [rows.problem.names.index(name) for name in suspect.names]
    moved = (rows.table.velocity[:, at] @ evidence.size).reshape(-1, 6)[:, :3]
    return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))


def _errors_of(rows: NewRows) -> tuple[tuple[str, float, Unit], ...]:
    """Kind, RMS of the errors, and unit, of the first block of each term."""
    answer, blocks = list[tuple[str, float, Unit]](), iter(rows.rows)
    for term in rows.problem.terms:
        mine = [next(blocks) for _ in term.blocks]
        errors = np.linalg.norm(mine[0].line.error, axis=1)
        answer.append((term.kind, float(np.sqrt(np.mean(errors**2))), term.error_unit))
    return tuple(answer)
