"""Where to measure next, for a terminal of 80 columns and as files to take to the bench."""

from __future__ import annotations

import csv
import io
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from ruamel.yaml import YAML

from suta_calib.analysis.planning import Choice, Placement, Plan, Point, Posture
from suta_calib.report.console import bullet, number_table, plain_table, verdict_lines
from suta_calib.report.planning.json import MM, place_dict, plan_verdict, rounded
from suta_calib.report.planning.words import plan_sentences, remedy_sentences
from suta_calib.units import NOTHING, text, unit_name

CHOSEN_HEADS: Final = ("", "what", "position, mm", "roll pitch yaw, deg", "tip, mm", "gain")
PARAMETER_HEADS: Final = ("parameter", "now ±", "then ±", "unit")
_CSV: Final = (
    *("name", "kind", "x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg", "tilt_deg"),
    *("samples", "tip_mm"),
)


def plan_tables(found: Plan) -> RenderableType:
    """The verdict, the plan, the parameters, and what else must be known."""
    parts: list[RenderableType] = [*verdict_lines(plan_verdict(found)), "", _chosen(found), ""]
    parts += [_parameters(found), ""]
    parts += [bullet(sentence) for sentence in (*remedy_sentences(found), *plan_sentences(found))]
    return Group(*parts)


def chosen_rows(found: Plan) -> list[list[str]]:
    """Cells of the plan, one row a candidate."""
    return [
        [
            choice.candidate.name,
            choice.candidate.sort,
            *_where(choice),
            f"{MM * choice.tip:.3f}",
            f"{100 * choice.gain:.0f} %",
        ]
        for choice in found.chosen
    ]


def parameter_rows(found: Plan) -> list[list[str]]:
    """Cells of the predicted standard deviations; a dash where a parameter is held."""
    rows = []
    for before, after in zip(found.before.parameters, found.after.parameters, strict=True):
        cells = [NOTHING if e.std is None else text(e.std, e.unit) for e in (before, after)]
        rows.append([before.name, *cells, unit_name(before.unit)])
    tips = [f"{MM * forecast.tip:.3f}" for forecast in (found.before, found.after)]
    estimated = [f"{MM * forecast.tip_estimated:.3f}" for forecast in (found.before, found.after)]
    return [
        *rows,
        ["tip in the region", *tips, "mm"],
        ["… if what is held is exact", *estimated, "mm"],
    ]


def plan_csv(found: Plan) -> str:
    """One row a place: for the bench."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*_CSV, *_posture_columns(found)])
    for choice in found.chosen:
        writer.writerow(_csv_row(choice, found))
    return out.getvalue()


def plan_yaml(found: Plan) -> str:
    """The same as a candidates file: it can be trimmed, changed and planned with again."""
    content: dict[str, Any] = {"repeats": found.options.repeats}
    for choice in found.chosen:
        place = choice.candidate.place
        if isinstance(place, Posture):
            content.setdefault("poses", {})[place.name] = _posture(place, found)
        else:
            key = "placements" if isinstance(place, Placement) else "points"
            content.setdefault(key, {})[place.name] = place_dict(place)
    out = io.StringIO()
    yaml = YAML()
    yaml.default_flow_style = None
    yaml.width = 1000
    yaml.dump(content, out)
    return "# Where to measure next; suta-calib plan reads this file with --candidates.\n" + (
        out.getvalue()
    )


def _chosen(found: Plan) -> Table:
    table = plain_table("What to measure next, best first")
    for k, head in enumerate(CHOSEN_HEADS):
        table.add_column(head, justify="right" if k > 1 else "left", no_wrap=k in (0, 4, 5))
    for row in chosen_rows(found):
        table.add_row(*(Text(cell) for cell in row))
    return table


def _parameters(found: Plan) -> Table:
    table = number_table("Predicted standard deviations", *PARAMETER_HEADS)
    for row in parameter_rows(found):
        table.add_row(*(Text(cell) for cell in row))
    return table


def _where(choice: Choice) -> tuple[str, str]:
    place = choice.candidate.place
    if isinstance(place, Posture):
        return NOTHING, NOTHING
    position = "{:.0f} {:.0f} {:.0f}".format(*(MM * place.position))
    if isinstance(place, Point):
        return position, f"{place.directions} directions"
    rpy = place_dict(place)["rotation_rpy_deg"]
    return position, "{:.0f} {:.0f} {:.0f}".format(*rpy)


def _csv_row(choice: Choice, found: Plan) -> list[Any]:
    candidate, place = choice.candidate, choice.candidate.place
    where: list[Any] = [""] * 7
    if isinstance(place, Placement):
        pose = place_dict(place)
        where = [*pose["position_mm"], *pose["rotation_rpy_deg"]]
        where.append(round(float(np.degrees(place.tilt)), 3))
    elif isinstance(place, Point):
        where[:3] = rounded(MM * place.position)
    columns = _posture_columns(found)
    readings: list[Any] = [""] * len(columns)
    if isinstance(place, Posture):
        scaled = place.readings * np.array(list(columns.values()))
        readings = rounded(scaled, 4)
    tip = round(MM * choice.tip, 4)
    return [candidate.name, place.kind, *where, candidate.samples, tip, *readings]


def _posture(place: Posture, found: Plan) -> dict[str, dict[str, float]]:
    content: dict[str, dict[str, float]] = {}
    for (column, scale), reading in zip(
        _posture_columns(found).items(), place.readings, strict=True
    ):
        joint, _, unit = column.rpartition("_")
        content.setdefault(f"posture_{unit}", {})[joint] = rounded(np.array([scale * reading]), 6)[
            0
        ]
    return content


def _posture_columns(found: Plan) -> dict[str, float]:
    """Columns of postures with what makes SI degrees or mm; only where one is planned."""
    if not any(isinstance(c.candidate.place, Posture) for c in found.chosen):
        return {}
    degrees = 180.0 / np.pi
    return {
        f"{joint.name}_{'mm' if joint.type == 'prismatic' else 'deg'}": (
            MM if joint.type == "prismatic" else degrees
        )
        for joint in found.situation.arm.chain.moving
    }
