"""A box in the base frame as an option: ``X0,X1,Y0,Y1,Z0,Z1`` in mm."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click
import numpy as np

if TYPE_CHECKING:
    from suta_calib.analysis.planning import Region, Situation


def _numbers(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> tuple[float, ...] | None:
    """As many finite numbers as the option's metavar names, with commas between them."""
    if value is None:
        return None
    names = str(parameter.metavar)
    try:
        numbers = tuple(float(part) for part in value.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != names.count(",") + 1 or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"found {value!r}; expected {names} in mm", context, parameter)
    return numbers


region_option = click.option(
    "--region",
    metavar="X0,X1,Y0,Y1,Z0,Z1",
    callback=_numbers,
    help="Where the tip works, mm; by default around what was touched.",
)
place_option = click.option(
    "--register-at", metavar="X,Y,Z", callback=_numbers, help="Where one registers, mm."
)


def box_of(numbers: tuple[float, ...] | None, situation: Situation) -> Region | None:
    """The box as a region, with the tool as it was held.

    Raises:
        JobError: it has no volume.
    """
    if numbers is None:
        return None
    from suta_calib.analysis.planning import Region

    corners = 1e-3 * np.array(numbers)
    return Region.box(corners[::2], corners[1::2], situation)
