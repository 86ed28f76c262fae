"""Report of parameters: what data can determine, estimates, and why some have none."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from suta_calib.assessment import attempt
from suta_calib.model.parameters import Parameter
from suta_calib.report.document import Document, Part, Text, section
from suta_calib.report.listing import Column, Json, Listing, Place, Tone, written
from suta_calib.solver.identifiability import Identification
from suta_calib.solver.solution import Estimate, Solution, State
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.explanation import Explanation, as_drawn_names, redundant_names
from suta_calib.trust.observability import Observability, Prospect
from suta_calib.units import Unit, text, unit_name
from suta_calib.words import kept, listed

NAME: Final = "observability"
# Of one remedy's explanations, those that a console shows.
MOST_SENTENCES: Final = 3

EXPLANATIONS: Final = Listing[Explanation](
    "Why these parameters keep their URDF values",
    Column("held", "held", lambda row: row.fixed),
    Column("sentence", "why"),
    Column("remedy", "what to do"),
    Column("told", value=lambda row: row.reason),
)


def observability_document(observability: Observability) -> Document:
    """Document of the parameters of arm and terms that the data determine."""
    prospects = list(observability.prospects.values())
    arm = observability.problem.arm_count or len(prospects)
    parts: list[Part] = [
        PROSPECTS.of(prospects[:arm]),
        PROSPECTS.of(prospects[arm:], "Unknowns of the observations", place="detail"),
        Text(conditioning(observability)),
        *section(
            "explanations",
            lambda: explained(observability.explanations, "everywhere", MOST_SENTENCES),
        ),
    ]
    data = {
        "samples": observability.samples,
        "equations": observability.equations,
        "unknowns": observability.unknowns,
        "rank": observability.rank,
        "asked": observability.asked,
        "condition": observability.condition,
        "singular_values": observability.singular_values,
        "indices": observability.indices.as_dict(),
        "parameters": PROSPECTS.records(prospects),
        "unidentified": observability.unidentified,
        "redundant": observability.redundant,
        "unobservable": unobservable(observability.identification),
        "explanations": EXPLANATIONS.records(observability.explanations),
    }
    return Document(NAME, "What these data can determine", observability.assessment, parts, data)


def conditioning(observability: Observability) -> str:
    """How evenly the identified parameters are determined, in a sentence."""
    identified = len(observability.singular_values)
    if not identified:
        return "The data alone determine no parameter."
    indices = ", ".join(
        f"{name} {value:.3g}" for name, value in observability.indices.as_dict().items()
    )
    return (
        f"Of the {identified} that the data determine: condition number "
        f"{observability.condition:.3g}, {indices} (parameters in plausible ranges, residuals in "
        "standard deviations)."
    )


def explained(
    explanations: Iterable[Explanation], place: Place, most: int | None = None
) -> list[Text]:
    """Why parameters are held, and below those that share a remedy, the remedy.

    What is redundant is one line: nothing is to be done about it. Another names what no data of
    these kinds could tell either, but the tip depends on.

    Args:
        explanations: explanations.
        place: where they are shown.
        most: of one remedy; the others are counted.
    """
    together: dict[str, list[str]] = {}
    redundant, as_drawn = list[str](), list[str]()
    for explanation in explanations:
        if explanation.reason == "redundant":
            (as_drawn if explanation.as_drawn else redundant).append(explanation.fixed)
        else:
            together.setdefault(explanation.remedy, []).append(explanation.sentence)
    parts = []
    for remedy, sentences in together.items():
        more = 0 if most is None else max(len(sentences) - most, 0)
        shown_sentences = [*sentences[:most], *([f"and {more} more of this sort"] if more else [])]
        parts += [Text(sentence, bullet=True, place=place) for sentence in shown_sentences]
        parts.append(Text(remedy, place=place, look="remedy"))
    if redundant:
        said_once = (
            "Redundant parameters keep their URDF values. This is harmless, because they never "
            f"move the tip: {listed(redundant)}."
        )
        parts.append(Text(said_once, place=place))
    if as_drawn:
        said_once = (
            "No data of these kinds can determine the following parameters. They keep their URDF "
            f"values, and an error there moves the tip: {listed(as_drawn)}."
        )
        parts.append(Text(said_once, place=place))
    return parts


def held_directions(solution: Solution) -> list[Json]:
    """Of each parameter of the arm that is held: how far off it may be, and what follows it.

    Whoever reads the answer back learns from it what the covariance leaves out, SI.
    """
    arm = solution.problem.arm_parameters if solution.converged else {}
    return [
        {
            "parameter": c.fixed,
            "plausible": arm[c.fixed].plausible,
            "direction": {n: v for n, v in c.direction.items() if n in arm},
        }
        for c in solution.identification.combinations
        if c.fixed in arm
    ]


def unobservable(identification: Identification) -> list[dict[str, float]]:
    """Combinations of several parameters that change no observation: factors by name."""
    return [dict(c.direction) for c in identification.combinations if not c.alone]


# Of a longer list a console leaves out what is held.
MANY: Final = 20
TONE: Final[dict[State, Tone]] = {
    "identified": "good",
    "unidentified": "care",
    "prior": "note",
    "at_bound": "bad",
    "fixed": "soft",
}


@dataclass(frozen=True)
class Outcome:
    """A parameter's estimate, with its nominal value and prior.

    Attributes:
        estimate: what came out.
        known: what went in.
        converged: whether the estimate is one.
        redundant: whether no data of these kinds could tell it.
        as_drawn: whether the tip depends on it all the same; otherwise it is a convention.
    """

    estimate: Estimate
    parameter: Parameter
    converged: bool
    redundant: bool = False
    as_drawn: bool = False

    @property
    def unit(self) -> Unit:
        """Of its value: m, rad or rad/Nm."""
        return self.estimate.unit

    @property
    def change(self) -> float | None:
        """From nominal, SI; None where it was held there."""
        e = self.estimate
        return None if e.state in ("unidentified", "fixed") else e.value - e.nominal

    @property
    def state(self) -> str:
        """The estimate's state, or that it is none."""
        return self.estimate.state if self.converged else "not_converged"

    def known(self, name: str) -> Any:
        """``value``, ``std`` or ``given`` of the estimate; nothing where it is none."""
        return getattr(self.estimate, name) if self.converged else () if name == "given" else None

    def worth_showing(self, among: int) -> bool:
        """Whether it is more than what was known; among many, also whether the data tell it."""
        e = self.estimate
        if e.state == "prior":
            # Moved by a tenth of what is uncertain about it.
            return abs(e.value - e.nominal) >= 0.1 * (e.std or 0.0)
        return among <= MANY or e.state != "unidentified"


def _bounds(row: Outcome) -> tuple[float, float] | None:
    """Lower and upper, SI; None without any."""
    limits = row.parameter.lower, row.parameter.upper
    return limits if any(map(math.isfinite, limits)) else None


def _unit(row: Outcome | Prospect) -> Unit:
    return row.unit


def state_shown(row: Outcome | Prospect) -> str:
    """The state in words; ``redundant`` or ``as drawn`` where no such data could tell it."""
    if row.as_drawn:
        return "as drawn"
    return "redundant" if row.redundant else row.state.replace("_", " ")


def _tone(row: Outcome | Prospect, state: State) -> Tone:
    return "note" if row.as_drawn else "soft" if row.redundant else TONE[state]


PARAMETERS: Final = Listing[Outcome](
    "Parameters",
    Column("name", "parameter", lambda row: row.estimate.name),
    Column("nominal", "nominal", lambda row: row.estimate.nominal, unit=_unit, si=True),
    Column("value", "value", lambda row: row.known("value"), _unit, si=True),
    Column("", "change", lambda row: row.change, unit=_unit, si=True, sign=True),
    Column("std", "± std", lambda row: row.known("std"), _unit, si=True),
    Column("unit", "unit", cell=lambda row: unit_name(row.unit)),
    Column("state", "state", cell=state_shown, tone=lambda row: _tone(row, row.estimate.state)),
    Column(
        "given",
        "valid while",
        lambda row: row.known("given"),
        cell=lambda row: kept(row.known("given")),
        optional=True,
    ),
    Column("scale", None, lambda _: 1.0),
    Column("prior", None, lambda row: row.parameter.prior, optional=True),
    Column("bounds", None, _bounds, optional=True),
    named=True,
)
# With the reason.
HELD: Final = Listing[tuple[Outcome, str]](
    "Redundant and fixed parameters keep their nominal value",
    *(
        column.over(lambda row: row[0])
        for column in PARAMETERS.columns
        if column.key in ("name", "nominal", "unit", "state")
    ),
    Column("", "why", lambda row: row[1]),
)
PROSPECTS: Final = Listing[Prospect](
    "What these readings can determine",
    Column("name", "parameter"),
    Column("nominal"),
    Column("plausible", "plausible", cell=lambda p: f"± {text(p.plausible, p.unit)}", numeric=True),
    *written("bound", "prior"),
    Column("std", "predicted ± std", unit=_unit, si=True),
    Column("unit", "unit", cell=lambda p: unit_name(p.unit)),
    Column("state", "state", cell=state_shown, tone=lambda p: _tone(p, p.state)),
    Column("given", "valid while", cell=lambda p: kept(p.given), optional=True),
    named=True,
)


def outcomes(examined: CalibrationExamination) -> list[Outcome]:
    """Every parameter's, in the problem's order."""
    solution, parameters = examined.solution, examined.solution.problem.parameters
    nothing: tuple[Explanation, ...] = ()
    why_held = attempt("shown: why they are held", lambda: examined.explanations, nothing)
    redundant, as_drawn = redundant_names(why_held), as_drawn_names(why_held)
    return [
        Outcome(estimate, parameters[name], solution.converged, name in redundant, name in as_drawn)
        for name, estimate in solution.estimates.items()
    ]
