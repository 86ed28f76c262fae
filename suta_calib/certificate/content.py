"""What a certificate says, before it is paper or JSON: SI inside, nothing of fonts or keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from suta_calib.certificate.lengths import LengthUncertainty
from suta_calib.display import Displayable
from suta_calib.trust.uncertainty_budget import UncertaintyBudget
from suta_calib.units import Unit, shown, unit_name
from suta_calib.words import listed

Outcome = Literal["conforms", "does not conform", "no decision"]
OF_ITSELF: Final = "limit of U itself"
GUARD_BAND: Final = (
    "Decision rule: a guard band as wide as U (JCGM 106:2012, 8.3; ILAC-G8:09/2019, 4.2.2). It "
    "conforms if |value| + U ≤ limit. It does not conform if |value| - U > limit. Otherwise, and "
    "where U is not known or lacks a source, no decision is made. A limit of U itself is compared "
    "with U."
)


@dataclass(frozen=True)
class CertifiedValue(Displayable):
    """One result.

    Attributes:
        name: of what it is.
        value: in SI; nan for a result that is an uncertainty alone.
        unit: of the value.
        std: its standard uncertainty; None where the answer states none.
        factor: coverage factor of the expanded uncertainty.
        remark: what a reader must know of this figure.
        rests_on: names of the references whose uncertainty belongs into U, or into the value where
            this is an uncertainty.
        is_uncertainty: whether the value is an expanded uncertainty itself.
        resolution: an expanded uncertainty to whose last digit a value without its own is shown.
    """

    name: str
    value: float
    unit: Unit
    std: float | None = None
    factor: float = 2.0
    remark: str = ""
    rests_on: tuple[str, ...] = ()
    is_uncertainty: bool = False
    resolution: float | None = None

    @property
    def expanded(self) -> float | None:
        """Expanded uncertainty, in SI."""
        return None if self.std is None else self.factor * self.std


@dataclass(frozen=True)
class ValueTable(Displayable):
    """Results that stand in one table, with a sentence on what they mean."""

    title: str
    quantities: tuple[CertifiedValue, ...]
    about: str = ""


@dataclass(frozen=True)
class Reference(Displayable):
    """What gave lengths their unit.

    Attributes:
        name: in a word, such as ``artefact``; a standard of the laboratory is ``of`` one.
        sentence: what of it is in U.
        included: its standard uncertainty as far as U includes it; None where it does not.
    """

    name: str
    sentence: str
    included: LengthUncertainty | None = None


@dataclass(frozen=True)
class Decision(Displayable):
    """Whether a result keeps within a limit, with a guard band as wide as its uncertainty.

    Accepted up to the limit less U, and rejected beyond the limit more U (JCGM 106:2012, 8.3;
    ISO 14253-1): between them the uncertainty does not allow a decision. Nor does a U that is
    unknown, or that lacks a source (ILAC-G8:09/2019). An uncertainty that lacks a source and is
    beyond its limit all the same does not conform: it can only be larger.

    Attributes:
        quantity: the result; its size counts.
        limit: that was asked for, SI.
        outcome: of the comparison.
        because: why there is no decision, or what was compared; may be empty.
        about: where U is from, in a sentence without its stop, where the results do not say it.
    """

    quantity: CertifiedValue
    limit: float
    outcome: Outcome
    because: str = ""
    about: str = ""

    @property
    def limit_text(self) -> str:
        """The limit as a reader sees it."""
        return f"{shown(self.limit, self.quantity.unit):.4g} {unit_name(self.quantity.unit)}"

    @property
    def words(self) -> str:
        """The outcome as a reader sees it."""
        return f"{self.outcome}: {self.because}" if self.because else self.outcome

    @classmethod
    def of(cls, quantity: CertifiedValue, limit: float) -> Decision:
        """By the rule of this class, as if U lacked nothing that is known."""
        if quantity.is_uncertainty:
            kept = abs(quantity.value) <= limit
            outcome: Outcome = "conforms" if kept else "does not conform"
            return cls(quantity, limit, outcome, OF_ITSELF)
        size, guard = abs(quantity.value), quantity.expanded
        if guard is not None and size + guard <= limit:
            return cls(quantity, limit, "conforms")
        if guard is not None and size - guard > limit:
            return cls(quantity, limit, "does not conform")
        return cls(quantity, limit, "no decision").known()

    def known(self) -> Decision:
        """This decision; none where U is unknown."""
        if self.quantity.expanded is None and not self.quantity.is_uncertainty:
            return replace(self, outcome="no decision", because="U unknown")
        return self

    def without(self, lacking: Mapping[str, str]) -> Decision:
        """This decision; none where U lacks what belongs into it.

        Args:
            lacking: what U lacks, in words, by the name of the reference.
        """
        words = [lacking[name] for name in self.quantity.rests_on if name in lacking]
        surely = self.quantity.is_uncertainty and self.outcome == "does not conform"
        if not words or surely or self.because == "U unknown":
            return self
        return replace(self, outcome="no decision", because=f"U lacks {listed(words)}")


@dataclass(frozen=True)
class Content(Displayable):
    """What an answer has to say on paper.

    Attributes:
        title: of the certificate.
        measurand: what was determined, one paragraph.
        method: how, and after which source.
        groups: the results.
        budgets: what their uncertainty is made of.
        checked: what validation showed, in rows of what and figure.
        judged: results that may be given a limit, by the key of the limit.
        decisions: that the answer took itself.
        rule: of the decisions, in sentences.
        references: what gave the lengths their unit, with its standard uncertainty, or that this is
            stated nowhere and in no U.
        notes: what must be known before the figures are used.
    """

    title: str
    measurand: str
    method: str
    groups: tuple[ValueTable, ...]
    budgets: tuple[UncertaintyBudget, ...] = ()
    checked: tuple[tuple[str, str], ...] = ()
    judged: Mapping[str, CertifiedValue] = field(default_factory=dict)
    decisions: tuple[Decision, ...] = ()
    rule: str = GUARD_BAND
    references: tuple[Reference, ...] = ()
    notes: tuple[str, ...] = ()
