"""How a recorded motion follows a reference, for a terminal of 80 columns."""

from __future__ import annotations

from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from suta_calib.report.console import number_table, verdict_lines
from suta_calib.report.path_accuracy.json import MS, dynamics_verdict, error_rows
from suta_calib.tracking.path_accuracy import PathAccuracy
from suta_calib.tracking.reversals import ChannelReversals
from suta_calib.units import NOTHING, text, unit_name

NAMES: Final = {
    "same_time": "at the same time",
    "latency_removed": "latency removed",
    "path": "across the path",
    "orientation": "orientation",
}


def dynamics_tables(found: PathAccuracy) -> RenderableType:
    """Latency, errors, reversals and the verdict."""
    alignment = found.alignment
    late = "later" if alignment.latency >= 0 else "earlier"
    latency = Text(
        f"Latency {MS * alignment.latency:.3f} ± {MS * alignment.latency_std:.3f} ms: the "
        f"recording comes {late} than the reference ({len(found.time)} rows, "
        f"{found.time[-1] - found.time[0]:.1f} s)",
        style="bold",
    )
    parts: list[RenderableType] = [latency, "", _errors(found), "", _reversals(found)]
    return Group(*parts, "", *verdict_lines(dynamics_verdict(found)))


def _errors(found: PathAccuracy) -> Table:
    table = number_table("Distance from the reference", "", "RMS", "mean", "95 %", "max")
    for key, (unit, figures) in error_rows(found).items():
        numbers = (figures.rms, figures.mean, figures.p95, figures.maximum)
        shown = [text(value, unit) for value in numbers]
        table.add_row(f"{NAMES[key]}, {unit_name(unit)}", *shown)
    return table


def _reversals(found: PathAccuracy) -> Table:
    columns = ("times", "before", "after", "jump")
    title = "Error where it turns back, mm RMS"
    table = number_table(
        title, found.per, *columns, *(["hysteresis"] if found.per == "joint" else [])
    )
    for each in found.reversals:
        lengths = (each.error_before, each.error_after, each.jump)
        row = [str(len(each.reversals)), *(text(value, "m") for value in lengths)]
        if found.per == "joint":
            row.append(_hysteresis(found, each))
        table.add_row(Text(each.channel.name), *row)
    return table


def _hysteresis(found: PathAccuracy, each: ChannelReversals) -> str:
    if each.channel.name not in found.hysteresis:
        return NOTHING
    size, std = found.hysteresis[each.channel.name]
    unit = each.channel.unit
    return f"{text(size, unit)} ± {text(std, unit, with_unit=True)}"
