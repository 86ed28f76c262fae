"""What a data set can determine, told: every parameter's prospect, and why some have none."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from suta_calib.report.document import Document, Part, Text, section
from suta_calib.report.listing import Column, Json, Listing, Place
from suta_calib.report.parameters import PROSPECTS, left_out
from suta_calib.solver.identifiability import Identification
from suta_calib.solver.solution import Solution
from suta_calib.trust.explanation import Explanation
from suta_calib.trust.observability import Observability
from suta_calib.words import listed

NAME: Final = "observability"
# Of one remedy's explanations, those that a console shows.
MOST_SENTENCES: Final = 3

EXPLANATIONS: Final = Listing[Explanation](
    "Why parameters are held",
    Column("held", "held", lambda row: row.fixed),
    Column("sentence", "why"),
    Column("remedy", "what to do"),
    Column("told", value=lambda row: row.reason),
)


def observability_document(observability: Observability, *, verbose: bool = False) -> Document:
    """What data can tell; ``verbose`` lists the terms' own unknowns, which a line counts."""
    prospects = list(observability.prospects.values())
    arm = observability.problem.arm_count or len(prospects)
    parts: list[Part] = [
        PROSPECTS.of(prospects if verbose else prospects[:arm]),
        *([] if verbose else left_out(0, prospects[arm:])),
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
        return "The data alone identify nothing."
    indices = ", ".join(
        f"{name} {value:.3g}" for name, value in observability.indices.as_dict().items()
    )
    return (
        f"Of the {identified} that the data identify: condition number "
        f"{observability.condition:.3g}, {indices} (parameters in plausible ranges, "
        "residuals in sigmas)."
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
            f"Redundant, so at nominal by convention: {listed(redundant)}. No data of these kinds "
            "could tell them, and nothing but where frames are drawn depends on them."
        )
        parts.append(Text(said_once, place=place))
    if as_drawn:
        said_once = (
            f"Held at nominal, and no convention: {listed(as_drawn)}. No data of these kinds "
            "could tell them, but the tip depends on them: it is as good as its drawing there."
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
