"""Pictures of a plan as SVG: where things go on the bench, and what each more of them brings."""

from __future__ import annotations

from suta_calib.analysis.planning import Plan
from suta_calib.analysis.planning.plots import draw_bench, draw_gain
from suta_calib.plotting.look import WIDTH
from suta_calib.report.svg import picture, svg_text


def bench_drawing(plan: Plan, name: str = "plan_bench") -> str:
    """An SVG element: the arm, what was measured, and what to measure next; mm in the base."""
    with picture(name, (1.25 * WIDTH, 5.0)) as figure:
        draw_bench(figure, plan)
        return svg_text(figure, name, "Placements and points to measure next, about the arm")


def gain_curve(plan: Plan, name: str = "plan_gain") -> str:
    """An SVG element: predicted uncertainty of the tip by the number of further candidates."""
    with picture(name, (WIDTH, 3.2)) as figure:
        draw_gain(figure.subplots(), plan)
        return svg_text(figure, name, "Predicted uncertainty of the tip by further candidates")
