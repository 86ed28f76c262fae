"""An answer shown: on the console, as plots, as files and an HTML page.

An answer becomes a `Document` (``plan_document(plan)``), and the document is shown:
``rich.print(rendered(document))`` or `write_document`. Plots are SVG elements.

Names are imported when they are first used: a table needs no Matplotlib.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from suta_calib.lazy import public

if TYPE_CHECKING:
    from suta_calib.plotting.planar import draw_arm as draw_arm
    from suta_calib.plotting.planar import outline as outline
    from suta_calib.plotting.style import BLUE as BLUE
    from suta_calib.plotting.style import GREY as GREY
    from suta_calib.plotting.style import ORANGE as ORANGE
    from suta_calib.plotting.style import WIDTH as WIDTH
    from suta_calib.plotting.style import plain_log as plain_log
    from suta_calib.plotting.style import style as style
    from suta_calib.report.calibration import calibration_document as calibration_document
    from suta_calib.report.certification import certification_document as certification_document
    from suta_calib.report.certification import certification_plot as certification_plot
    from suta_calib.report.comparison import comparison_document as comparison_document
    from suta_calib.report.console import rendered as rendered
    from suta_calib.report.document import Document as Document
    from suta_calib.report.error_budget import budget_document as budget_document
    from suta_calib.report.error_budget import budget_plot as budget_plot
    from suta_calib.report.files import write_document as write_document
    from suta_calib.report.hand_eye import hand_eye_document as hand_eye_document
    from suta_calib.report.iso10360 import acceptance_document as acceptance_document
    from suta_calib.report.iso10360 import acceptance_plot as acceptance_plot
    from suta_calib.report.model_selection import (
        model_selection_document as model_selection_document,
    )
    from suta_calib.report.model_selection import models_plot as models_plot
    from suta_calib.report.observability import observability_document as observability_document
    from suta_calib.report.outliers import outliers_document as outliers_document
    from suta_calib.report.path_accuracy import path_accuracy_document as path_accuracy_document
    from suta_calib.report.path_accuracy import path_accuracy_plot as path_accuracy_plot
    from suta_calib.report.pivot import pivot_document as pivot_document
    from suta_calib.report.plan import plan_document as plan_document
    from suta_calib.report.plan_plots import bench_drawing as bench_drawing
    from suta_calib.report.plan_plots import gain_curve as gain_curve
    from suta_calib.report.pose_plots import draw_axes as draw_axes
    from suta_calib.report.pose_plots import hand_eye_plot as hand_eye_plot
    from suta_calib.report.pose_plots import pivot_plot as pivot_plot
    from suta_calib.report.pose_plots import register_plot as register_plot
    from suta_calib.report.registration import register_document as register_document
    from suta_calib.report.repeatability import repeatability_document as repeatability_document
    from suta_calib.report.repeatability_plots import stationary_plot as stationary_plot
    from suta_calib.report.repeatability_plots import visits_plot as visits_plot
    from suta_calib.report.stereotactic import stereotactic_document as stereotactic_document
    from suta_calib.report.stereotactic import stereotactic_plot as stereotactic_plot
    from suta_calib.report.study import size_plot as size_plot
    from suta_calib.report.study import spread_plot as spread_plot
    from suta_calib.report.study import study_document as study_document
    from suta_calib.report.svg import svg_text as svg_text
    from suta_calib.report.tip_map import tip_map_document as tip_map_document
    from suta_calib.report.tip_map import tip_map_plot as tip_map_plot
    from suta_calib.report.zero_offsets import zero_offsets_document as zero_offsets_document

__getattr__, __all__ = public(__name__)
