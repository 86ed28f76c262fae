"""The true arm: nominal plus errors that are stated or drawn."""

from __future__ import annotations

from suta_calib.errors import JobError, ParameterError
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Parameter
from suta_calib.simulation.noise import stream
from suta_calib.simulation.schema import SUFFIX, ErrorRow, SimulationSpec


def true_values(arm: ArmModel, spec: SimulationSpec, seed: int) -> dict[str, float]:
    """True values of all the arm's placements and offsets, nominal where no row names them.

    Eccentricity and compliance are among them only where a row gives them.

    A parameter's random number depends on the seed and its name alone, so a change to one row
    leaves the others' parameters as they were.

    Args:
        arm: the nominal arm.
        spec: whose ``errors`` are applied; later rows win.
        seed: of the drawn errors.

    Returns:
        Values by name, m, rad or rad/(N·m), in the arm's order.

    Raises:
        JobError: a row selects nothing, or gives no size in the unit of one it selects.
    """
    errors: dict[str, float] = {}
    for index, row in enumerate(spec.errors):
        for name in _selected(arm, row, index, spec):
            errors[name] = _error(arm.offered[name], row, index, seed, spec)
    told = [n for n in arm.offered if n in errors or n in arm.parameters]
    return {n: arm.offered[n].nominal + errors.get(n, 0.0) for n in told}


def _selected(arm: ArmModel, row: ErrorRow, index: int, spec: SimulationSpec) -> tuple[str, ...]:
    """Names a row means; ``geometric`` and globs reach units the row gives no size for."""
    try:
        names = arm.select(*row.select).names
    except ParameterError as problem:
        where = f"errors[{index}].select"
        raise JobError(
            problem.found,
            problem.expected,
            file=spec.path,
            line=row.line,
            where=where,
            hint=problem.hint,
        ) from None
    sized = {*row.value, *row.std}
    return tuple(n for n in names if n in row.select or arm.offered[n].unit in sized)


def _error(
    parameter: Parameter, row: ErrorRow, index: int, seed: int, spec: SimulationSpec
) -> float:
    if parameter.unit in row.value:
        return row.value[parameter.unit]
    if parameter.unit in row.std:
        return row.std[parameter.unit] * float(stream(seed, parameter.name).standard_normal())
    suffix = SUFFIX[parameter.unit]
    raise JobError(
        f"no size of the error of {parameter.name}",
        f"value_{suffix} or std_{suffix}",
        file=spec.path,
        line=row.line,
        where=f"errors[{index}]",
    )
