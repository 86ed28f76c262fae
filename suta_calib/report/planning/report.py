"""The plan's section of ``report.html``, and the files to take to the bench."""

from __future__ import annotations

from suta_calib.analysis.planning import Plan
from suta_calib.report.planning.json import plan_verdict
from suta_calib.report.planning.plots import bench_drawing, gain_curve
from suta_calib.report.planning.tables import (
    CHOSEN_HEADS,
    PARAMETER_HEADS,
    chosen_rows,
    parameter_rows,
    plan_csv,
    plan_yaml,
)
from suta_calib.report.planning.words import plan_sentences, remedy_sentences
from suta_calib.report.sections import Plot, Section, Table, Text

_WHAT = (
    "Predicted from the Jacobian at the arm as it is known, with the solver's own covariance (rows "
    "that share a sample are not independent) and the noise that the present residuals show, "
    "whatever makes them. 'tip' is the 3-D root mean square uncertainty of "
    "the tip in the region after a rigid registration, with parameters that would be held as far "
    "off as their bounds say."
)


def plan_section(found: Plan) -> Section:
    """Verdict, the plan as a table and a drawing, what each more brings, and the parameters."""
    return Section(
        name="plan",
        title="Where to measure next",
        assessment=plan_verdict(found),
        parts=[
            Table(CHOSEN_HEADS, chosen_rows(found), frozenset({2, 3, 4, 5}), "Best first"),
            Plot(bench_drawing(found), "On the bench"),
            *(Text(sentence) for sentence in remedy_sentences(found)),
            Plot(gain_curve(found), "What each more would bring"),
            *(Text(sentence) for sentence in plan_sentences(found)),
            Table(
                PARAMETER_HEADS,
                parameter_rows(found),
                frozenset({1, 2}),
                "Predicted standard deviations",
            ),
            Text(_WHAT),
        ],
    )


def bench_files(found: Plan) -> dict[str, str]:
    """``plan.csv`` and ``plan.yaml`` by name."""
    return {"plan.csv": plan_csv(found), "plan.yaml": plan_yaml(found)}
