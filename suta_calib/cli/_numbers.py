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


def metres(numbers: tuple[float, ...] | None) -> FloatArray | None:
    """Numbers of an option as an array, m."""
    return None if numbers is None else from_mm(np.array(numbers))


def corners(numbers: tuple[float, ...] | None) -> FloatArray | None:
    """A box's lower and upper corner (2, 3), m."""
    box = metres(numbers)
    return None if box is None else box.reshape(3, 2).T
