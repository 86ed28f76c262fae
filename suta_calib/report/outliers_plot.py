"""The picture of an outlier analysis as SVG."""

from __future__ import annotations

from suta_calib.analysis.outliers import TermOutliers
from suta_calib.analysis.outliers.plots import draw_metrics
from suta_calib.plotting.look import LARGE
from suta_calib.report.svg import picture, svg_text


def metrics_plot(term: TermOutliers, name: str) -> str:
    """An SVG: the four metrics of an observation over the artefact, or group by group."""
    with picture(name, (LARGE, 7.2)) as figure:
        draw_metrics(figure, term)
        return svg_text(figure, name, f"The four outlier metrics {term.drawn_over}")
