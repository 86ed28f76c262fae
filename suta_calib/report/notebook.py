"""Shows objects in a notebook: the tables of their reports, without pictures and files.

A class that is `showing.Shown` has an entry here: the parts of a document in order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

from suta_calib.analysis.outliers import Outliers
from suta_calib.analysis.planning import Plan
from suta_calib.analysis.residual_map import ResidualMap
from suta_calib.analysis.tip_map import TipMap
from suta_calib.atomic import write_bytes_atomically
from suta_calib.display import Displayable as ShowsItself
from suta_calib.job.calibration import Calibration
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ChainJoint
from suta_calib.model.parameters import Parameter, ParameterSet
from suta_calib.pose_calibration.hand_eye import HandEyeCalibration
from suta_calib.pose_calibration.many_eyes import ManyEyesCalibration
from suta_calib.pose_calibration.pivot import PivotCalibration
from suta_calib.pose_calibration.registration import Registration
from suta_calib.report.calibration import calibration_document
from suta_calib.report.document import Shown
from suta_calib.report.errors import errors_table
from suta_calib.report.hand_eye import frame_tables
from suta_calib.report.listing import Column, Listing, components, shown_as
from suta_calib.report.many_eyes import found_tables
from suta_calib.report.observability import PARAMETERS, observability_document, outcomes
from suta_calib.report.outliers import outliers_document
from suta_calib.report.page import environment, page_with
from suta_calib.report.pivot import places_table
from suta_calib.report.plan import plan_document
from suta_calib.report.registration import transform_table
from suta_calib.report.residual_map import residual_map_document
from suta_calib.report.tip_map import tip_map_document
from suta_calib.solver.solution import Solution
from suta_calib.trust.calibration_examination import CalibrationExamination
from suta_calib.trust.observability import Observability
from suta_calib.units import text, unit_name

JOINTS: Final = Listing[ChainJoint](
    "",
    Column("name", "joint"),
    Column("type", "type"),
    *components(("x, mm", "y, mm", "z, mm"), attrgetter("xyz"), "m"),
    *components(("roll, deg", "pitch, deg", "yaw, deg"), attrgetter("rpy"), "rad"),
    shown_as("axis", lambda j: " ".join(f"{v:g}" for v in j.axis) if j.moving else ""),
    Column("child", "carries"),
)
UNKNOWNS: Final = Listing[Parameter](
    "",
    Column("name", "parameter"),
    Column("nominal", "nominal", unit=attrgetter("unit")),
    shown_as("may be wrong by ±", lambda p: text(p.plausible, p.unit)),
    shown_as("prior ± std", lambda p: text(p.prior, p.unit)),
    Column("unit", "unit", cell=lambda p: unit_name(p.unit)),
    Column("", "", lambda p: "" if p.free else "fixed"),
)


def html_of(shown: ShowsItself) -> str:
    """HTML of an object, to stand in a page among others; every text in it is escaped."""
    # To judge a solution takes solving, which showing it must not: only if somebody asked before.
    if isinstance(shown, Solution):
        assessment = vars(shown).get("assessment")
    else:
        assessment = getattr(shown, "assessment", None)
    return (
        environment()
        .get_template("notebook.html.j2")
        .render(
            kind=type(shown).__name__,
            said=shown.in_a_line,
            assessment=assessment,
            parts=parts_of(shown),
        )
    )


def _parameters(examined: CalibrationExamination) -> Shown:
    """Parameters of the arm; those of the terms where there is no arm."""
    every = outcomes(examined)
    return PARAMETERS.of(every[: examined.solution.problem.arm_count] or every, "")


def write_page(answer: Calibration, path: Path) -> None:
    """Write the report of an answer as one page.

    Raises:
        OutputError: the file cannot be written.
    """
    page = page_with(calibration_document(answer), None, answer.job.spec.path.name)
    write_bytes_atomically(path, page.encode(errors="replace"))


def _of_calibration(shown: Calibration) -> Sequence[Shown]:
    sets = {"calibration": shown.accuracy.calibration, "validation": shown.accuracy.validation}
    return errors_table(sets), _parameters(shown.examined)


# What is shown of an object beside its line, by its class.
PARTS: Final[dict[type, Callable[[Any], Sequence[Shown]]]] = {
    ArmModel: lambda arm: [JOINTS.of(arm.chain.joints)],
    ParameterSet: lambda parameters: [UNKNOWNS.of(parameters.values())],
    Solution: lambda solution: [_parameters(CalibrationExamination.of(solution))],
    Calibration: _of_calibration,
    PivotCalibration: lambda pivot: [places_table(pivot, labelled=len(pivot.posts) > 1)],
    HandEyeCalibration: lambda eye: [*frame_tables(eye)],
    ManyEyesCalibration: lambda eyes: [*found_tables(eyes)],
    Registration: lambda registration: [transform_table(registration)],
    Observability: lambda shown: observability_document(shown).shown("console"),
    Outliers: lambda shown: outliers_document(shown).shown("console"),
    Plan: lambda shown: plan_document(shown).shown("console"),
    ResidualMap: lambda shown: residual_map_document(shown).shown("console"),
    TipMap: lambda shown: tip_map_document(shown).shown("console"),
}


def parts_of(shown: ShowsItself) -> Sequence[Shown]:
    """The parts that a notebook shows of an object; nothing beside its line, of any other."""
    return next((PARTS[kind](shown) for kind in type(shown).__mro__ if kind in PARTS), ())
