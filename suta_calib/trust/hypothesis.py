"""One way in which data can be wrong, or a model too simple: one file each in ``hypotheses/``."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, ClassVar, Final, Literal, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level, attempt
from suta_calib.display import Displayable
from suta_calib.registry import all_classes
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.terms.term import Term
from suta_calib.trust.evidence import Effect, Evidence, weigh_effects
from suta_calib.trust.examination import Examination
from suta_calib.trust.rule import Rule
from suta_calib.units import text

T = TypeVar("T")
# The true parameters of data, by name.
Truth = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class SpoiltData(Displayable):
    """Data with a fault of known size.

    Attributes:
        data: with the fault.
        size: (k,) of the fault, as `Evidence.size` should estimate it; NaN where that is not known,
            empty where it has none.
        effect: name of the effect that describes it; empty where there is only one.
    """

    data: Any
    size: FloatArray = field(default_factory=lambda: np.zeros(0))
    effect: str = ""


class Hypothesis(ABC):
    """One way in which data can be wrong, or a model too simple.

    A new one is a module in ``hypotheses/`` with a subclass, or an entry point of another package
    in the group ``suta_calib.hypotheses``; nothing else names it.
    `tests/trust/test_contract.py` then holds it to the contract: data that `spoil` made are named
    with the right size, and sound data are silent.

    Attributes:
        name: unique, a few words, for tables and for tests.
        about: what is wrong then, one line.
        applies_to: kinds of terms that can have it; an answer with none of them is not examined.
        needs_arm: whether it is about an arm (True), or about measured poses (False).
        before_others: whether it is said before other readings of the data and before changes where
            it is the strongest, because its fault looks like these.
        by_itself: whether it is tested by a fit of its own, and not beside the other hypotheses.
        worth, times_std, false_alarm: thresholds that replace those of the `Rule` where they are
            less; the module says why.
        confirmed_later: whether other tests must confirm it, so that it is no `strongest_cause`.
        checked_as: what `check` calls it where it may be new since a calibration; empty where the
            parameters of the arm and of the terms describe it, or where it does not come later.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    applies_to: ClassVar[tuple[type[Term], ...]] = (Term,)
    needs_arm: ClassVar[bool] = True
    before_others: ClassVar[bool] = False
    by_itself: ClassVar[bool] = False
    confirmed_later: ClassVar[bool] = False
    worth: ClassVar[float] = 1.0
    times_std: ClassVar[float] = math.inf
    false_alarm: ClassVar[float] = 1.0
    checked_as: ClassVar[str] = ""

    def applies(self, problem: Problem) -> bool:
        """Whether an answer of this problem can have it."""
        right = any(isinstance(term, self.applies_to) for term in problem.terms)
        return right and self.needs_arm == (problem.arm is not None)

    def weigh(self, answer: Examination) -> list[Evidence]:
        """What the data say of it by themselves, strongest first."""
        return []

    def supported(self, evidence: Evidence, rule: Rule = Rule()) -> bool:
        """Whether it is worth a report."""
        return evidence.supported(
            replace(
                rule,
                share=min(rule.share, self.worth),
                times_std=min(rule.times_std, self.times_std),
                false_alarm=min(rule.false_alarm, self.false_alarm),
            )
        )

    def level(self, evidence: Evidence) -> Level:
        """What the answer is worth with it; ``good`` where it is not worth a word."""
        return "care"

    @abstractmethod
    def sentence(self, evidence: Any) -> str:
        """What was found, its size with ±, and what to do."""

    @abstractmethod
    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Put the fault into sound data.

        Args:
            data: a term.
            values: the true parameters, by name.
            rng: where random numbers come from.
        """


class AddedVariable(Hypothesis):
    """Something that no unknown of the answer describes: a coupling, a scale, a time offset."""

    @abstractmethod
    def effects(self, answer: Examination) -> Iterator[Effect]:
        """The effects to be tested, one after another."""

    def weigh(self, answer: Examination) -> list[Evidence]:
        """What the data say of its effects, by the fit as it is."""
        return weigh_effects(answer.fit, self.effects(answer))


class Reinterpretation(Hypothesis):
    """Data that are read differently and fitted again: units, order, sign, late by whole rows.

    Over an arm `trust.rereading` ranks the readings, fits the best, and compares them.

    Attributes:
        precedence: of hypotheses that explain data equally, the lowest is named.
        tried: ``ranked`` by the nominal arm, the best few are fitted; ``fitted`` in any case,
            where the nominal arm is too coarse to rank it; ``last``, only where nothing else is
            the cause.
    """

    precedence: ClassVar[int] = 100
    tried: ClassVar[Literal["ranked", "fitted", "last"]] = "ranked"

    @abstractmethod
    def readings(self, data: Any) -> Iterator[tuple[str, Any]]:
        """What would have to be so, and the data then.

        Over an arm the data are a `Problem`, and the words end "the data agree if …".
        """

    def readings_by(self, data: Any, rule: Rule) -> Iterator[tuple[str, Any]]:
        """Those that are tried by a rule: all of them by default."""
        return self.readings(data)

    def sentence(self, evidence: Any) -> str:
        """What explains the data, and how much better they agree then (`Rereading`)."""
        before, after = (
            text(value, evidence.unit, with_unit=True)
            for value in (evidence.before, evidence.after)
        )
        return f"The data agree far better ({after} instead of {before}) if {evidence.description}."


class Pattern(Hypothesis):
    """Rows or columns that honest data do not have: copied, stuck, rounded, sorted. No fit.

    Attributes:
        precedence: the lowest is said first.
        role: ``cause`` explains alone why nothing fits, and no other reading is looked for;
            ``note`` is said of every answer; ``suspicion``, which honest data may arouse as well,
            only where nothing fits and nothing else is the cause; ``rows``, single rows that a
            robust fit hides, where no other reading of all rows is the cause.
    """

    precedence: ClassVar[int] = 100
    role: ClassVar[Literal["cause", "note", "suspicion", "rows"]] = "note"

    def of_terms(self, terms: Sequence[Term]) -> Iterator[str]:
        """Sentences on the samples of terms: where the pattern is, and what to do."""
        raise NotImplementedError

    def matches(self, answer: Solution) -> Iterator[str]:
        """The same on those of an answer, where its residuals matter."""
        return self.of_terms(answer.problem.terms)

    def sentence(self, evidence: Any) -> str:
        """What was found is a sentence already."""
        return str(evidence)


@dataclass(frozen=True, eq=False)
class Finding(Displayable):
    """A hypothesis that the data support.

    Attributes:
        hypothesis: which.
        evidence: for it.
    """

    hypothesis: Hypothesis
    evidence: Evidence

    @property
    def sentence(self) -> str:
        """What was found, its size with ±, and what to do."""
        return self.hypothesis.sentence(self.evidence)

    @property
    def level(self) -> Level:
        """What the answer is worth with it."""
        return self.hypothesis.level(self.evidence)

    def supported(self, rule: Rule = Rule()) -> bool:
        """Whether it is worth a report."""
        return self.level != "good" and self.hypothesis.supported(self.evidence, rule)


# Of joints it is said more carefully (`trust.score_tests`): this test says whether what
# explains the residuals best is one of them.
LEFT_TO_SCORE_TESTS: Final = "joint error"


def strongest_cause(answer: Examination, rule: Rule = Rule()) -> Finding | None:
    """What explains the residuals of a calibration best beside all of the geometry.

    Returns:
        None without an arm, where nothing is supported, or where errors of one joint explain the
        residuals best.
    """
    if answer.arm is None:
        return None
    tested = [h for h in known_hypotheses().values() if not h.confirmed_later]
    findings = weigh(answer, hypotheses=tested)
    first = next(iter(findings), None)
    for finding in findings:
        # What looks like the others need not explain quite as much as the best of them.
        # Part of the strongest finding's share that one needs which is said before others.
        rival = first is not None and finding.evidence.share > 0.7 * first.evidence.share
        if finding.hypothesis.before_others and rival and finding.supported(rule):
            return finding
    if first is None or first.hypothesis.name == LEFT_TO_SCORE_TESTS or not first.supported(rule):
        return None
    return first


@cache
def known_hypotheses() -> dict[str, Hypothesis]:
    """Every hypothesis by its name, other packages' included."""
    classes = all_classes("hypotheses", Hypothesis, "suta_calib.trust.hypotheses")
    return {name: hypothesis() for name, hypothesis in sorted(classes.items())}


def examine(answer: Examination, rule: Rule = Rule()) -> list[Finding]:
    """Test all hypotheses about added variables that apply, strongest first.

    Args:
        answer: a converged one.
        rule: when evidence is reported. Its false-alarm rate is that of all tests together.
    """
    return [finding for finding in weigh(answer) if finding.supported(rule)]


def weigh(
    answer: Examination,
    failed: list[str] | None = None,
    hypotheses: Iterable[Hypothesis] | None = None,
) -> list[Finding]:
    """Every hypothesis that was tested with its evidence, supported or not, strongest first.

    Args:
        answer: a converged one.
        failed: where a sentence about each hypothesis that could not be tested is added. Without
            it the failure is raised.
        hypotheses: those that are tested; all by default.
    """
    owner: dict[int, Hypothesis] = {}
    effects, findings = list[Effect](), list[Finding]()

    def effects_of(hypothesis: Hypothesis) -> list[Effect]:
        return [*hypothesis.effects(answer)] if isinstance(hypothesis, AddedVariable) else []

    def tried(hypothesis: Hypothesis, what: Callable[[], list[T]]) -> list[T]:
        nothing = list[T]()
        if failed is None:
            return what()
        return attempt(f"judged: {hypothesis.name}", what, nothing, failed)

    for hypothesis in known_hypotheses().values() if hypotheses is None else hypotheses:
        if not hypothesis.applies(answer.problem):
            continue
        if hypothesis.by_itself:
            evidence = tried(hypothesis, partial(hypothesis.weigh, answer))
            findings += [Finding(hypothesis, item) for item in evidence]
            continue
        for effect in tried(hypothesis, partial(effects_of, hypothesis)):
            owner[id(effect)] = hypothesis
            effects.append(effect)
    findings += [Finding(owner[id(e.effect)], e) for e in weigh_effects(answer.fit, effects)]
    rows = answer.fit.rows
    return sorted(findings, key=lambda finding: -finding.evidence.criterion(rows))
