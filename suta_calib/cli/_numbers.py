"""Numbers on the command line, one or several: finite ones, in mm where they are places."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from suta_calib.units import from_mm

if TYPE_CHECKING:
    from suta_calib.arrays import FloatArray


class FiniteRange(click.FloatRange):
    """`click.FloatRange` that refuses ``nan``, which is out of no range, and ``inf`` too."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number, or a usage error that says what was found."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"found {value!r}; expected a finite number", param, ctx)
        return number


def _place(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> FloatArray | None:
    """As many finite numbers as the option's metavar names, with commas between them, in m."""
    if value is None:
        return None
    names = str(parameter.metavar)
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != names.count(",") + 1 or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"found {value!r}; expected {names} in mm", context, parameter)
    return from_mm(np.array(numbers))


def _box(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> FloatArray | None:
    """A lower and an upper corner (2, 3), m."""
    ends = _place(context, parameter, value)
    return None if ends is None else ends.reshape(3, 2).T


region_option = click.option(
    "--region",
    metavar="X0,X1,Y0,Y1,Z0,Z1",
    callback=_box,
    help="Where the tip works, mm; by default around what was touched.",
)
place_option = click.option(
    "--register-at", metavar="X,Y,Z", callback=_place, help="Where one registers, mm."
)
