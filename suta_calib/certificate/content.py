"""What a certificate says, before it is paper or JSON: SI inside, nothing of fonts or keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from suta_calib.display import Displayable
from suta_calib.trust.uncertainty_budget import UncertaintyBudget
from suta_calib.units import Unit, text

Outcome = Literal["conforms", "does not conform", "no decision"]
GUARD_BAND: Final = (
    "Decision rule: a guard band as wide as U (JCGM 106:2012, 8.3). A value conforms if its size "
    "and U together keep the limit. It does not conform if its size less U exceeds the limit. "
    "Between them no decision is made."
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
    """

    name: str
    value: float
    unit: Unit
    std: float | None = None
    factor: float = 2.0
    remark: str = ""

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
class Decision(Displayable):
    """Whether a result keeps within a limit, with a guard band as wide as its uncertainty.

    Accepted up to the limit less U, and rejected beyond the limit more U (JCGM 106:2012, 8.3;
    ISO 14253-1): between them the uncertainty does not allow a decision.

    Attributes:
        name: of the result.
        value: of it, SI; its size counts.
        expanded: its expanded uncertainty U; 0 for a limit on an uncertainty itself.
        limit: that was asked for.
        unit: of them.
        outcome: of the comparison.
        factor: coverage factor of U.
    """

    name: str
    value: float
    expanded: float
    limit: float
    unit: Unit
    outcome: Outcome
    factor: float = 2.0

    @property
    def limit_text(self) -> str:
        """The limit as a reader sees it."""
        return text(self.limit, self.unit, with_unit=True)

    @classmethod
    def of(cls, quantity: CertifiedValue, limit: float) -> Decision:
        """By the rule of this class."""
        guard, size = quantity.expanded or 0.0, abs(quantity.value)
        outcome: Outcome = "no decision"
        if size + guard <= limit:
            outcome = "conforms"
        elif size - guard > limit:
            outcome = "does not conform"
        return cls(
            *(quantity.name, quantity.value, guard, limit, quantity.unit, outcome),
            quantity.factor,
        )


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
        standards: what gave the lengths their unit, with its standard uncertainty, or that this is
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
    standards: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
