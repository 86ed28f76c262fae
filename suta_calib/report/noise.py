"""Noise levels and sizes of priors, told: as given or assumed, and as the data show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from suta_calib.job.calibration import Calibration
from suta_calib.report.listing import Column, Listing
from suta_calib.terms.block import Block
from suta_calib.units import Unit, text, unit_name

if TYPE_CHECKING:
    from suta_calib.solver.weights import Learned


@dataclass(frozen=True, eq=False)
class BlockNoise:
    """Noise of one block of residuals: as it was assumed, and as the residuals show it.

    Attributes:
        kind, label: of its term.
        block: of residuals.
        assumed: standard deviation of one component, m or rad.
        found: the same; None where the solution did not converge.
        interval: where it is with a chance of 95 %; None where it was weighed against nothing.
    """

    kind: str
    label: str
    block: Block
    assumed: float
    found: float | None
    interval: tuple[float, float] | None


def _unit(row: BlockNoise) -> Unit:
    return row.block.unit


def _between(interval: tuple[float, float], unit: Unit | None = None) -> str:
    return " … ".join(f"{end:.2f}" if unit is None else text(end, unit) for end in interval)


NOISE: Final = Listing[BlockNoise](
    "Noise",
    Column("kind"),
    Column("", "residuals", lambda row: f"{row.kind.replace('_', ' ')}: {row.block.name}"),
    Column("label", "label"),
    Column("block", None, lambda row: row.block.name),
    Column("unit", "unit", _unit, cell=lambda row: unit_name(_unit(row))),
    Column("assumed", "assumed", unit=_unit, si=True),
    Column(
        "given",
        "from",
        lambda row: row.block.noise.sigma is not None,
        cell=lambda row: "default" if row.block.noise.sigma is None else "the job",
    ),
    Column("found", "found", unit=_unit, si=True),
    Column(
        "interval",
        "95 %",
        unit=_unit,
        si=True,
        optional=True,
        cell=lambda row: _between(row.interval, row.block.unit) if row.interval else "",
    ),
)
PRIORS: Final = Listing["tuple[str, Learned]"](
    "Priors",
    Column("group", "of", lambda row: row[0]),
    Column("factor", "times what the job gives", lambda row: row[1].value, form=".2f"),
    Column(
        "interval", "95 %", lambda row: row[1].interval, cell=lambda row: _between(row[1].interval)
    ),
    Column("contradicted", None, lambda row: row[1].contradicted),
)


def noise_of(result: Calibration) -> list[BlockNoise]:
    """Of every block that was fitted."""
    solution = result.solution
    intervals = (
        [None] * len(solution.noise)
        if solution.weights is None
        else [level.interval for level in solution.weights.noise]
    )
    blocks = [
        (term.term.kind, label, block)
        for label, term in result.labelled_terms["calibration"]
        for block in term.term.blocks
    ]
    return [
        BlockNoise(*block, assumed, estimated if solution.converged else None, interval)
        for block, assumed, estimated, interval in zip(
            blocks, solution.problem.assumed_sigmas(), solution.noise, intervals, strict=True
        )
    ]


def priors_of(result: Calibration) -> list[tuple[str, Learned]]:
    """What was learned of the size of each group of priors."""
    weights = result.solution.weights
    return [] if weights is None else list(weights.priors.items())
