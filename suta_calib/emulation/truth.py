"""True parameters of an emulated arm: read from a file, drawn, or nominal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from suta_calib.errors import JobError, did_you_mean
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import OFFSET, POSITION, Parameter
from suta_calib.simulation import ErrorRow, SimulationSpec, read_simulation, true_values

# Sizes of drawn errors: those of a well-made arm whose encoders were set by eye.
_OFFSET_STD: Final = {"rad": 0.013, "m": 1e-3}  # 0.75°
_TILT_STD: Final = {"rad": 0.0017}  # 0.1°
_RAD_PER_DEG: Final = 0.017453292519943295


def nominal_values(arm: ArmModel) -> dict[str, float]:
    """Every parameter of the arm at nominal, m or rad."""
    return {name: parameter.nominal for name, parameter in arm.parameters.items()}


def read_truth(path: Path, arm: ArmModel, seed: int | None = None) -> dict[str, float]:
    """True parameters from a ``truth.yaml``, or from the ``errors`` of a ``simulation.yaml``.

    Args:
        path: the file.
        arm: the nominal arm; parameters the file does not list are nominal.
        seed: of errors that a simulation draws; its own by default.

    Returns:
        Values of all the arm's parameters, m or rad.

    Raises:
        JobError: unreadable, neither of the two, or a parameter that this arm does not have.
    """
    top = YamlSection(read_yaml(path, JobError), JobError)
    if "sets" in top:
        spec = read_simulation(path)
        return true_values(arm, spec, spec.seed if seed is None else seed)
    if "parameters" not in top or isinstance(top.data["parameters"], list):
        raise top.refuse(
            "neither a truth.yaml nor a simulation.yaml",
            "a mapping 'parameters' of true values, or 'errors' beside 'sets'",
            at=("parameters",),
        )
    listed = top.section("parameters") if top.data["parameters"] else None
    return nominal_values(arm) | ({} if listed is None else _values(listed, arm))


def _values(listed: YamlSection, arm: ArmModel) -> dict[str, float]:
    for name in listed.data:
        if name not in arm.parameters:
            raise listed.refuse(
                "a parameter that the arm does not have",
                "parameters of the arm given",
                at=(name,),
                hint=did_you_mean(name, arm.parameters),
            )
    return {name: _value(listed.section(name), arm.parameters[name]) for name in listed.data}


def _value(row: YamlSection, parameter: Parameter) -> float:
    key, scale = ("value_mm", 1e-3) if parameter.unit == "m" else ("value_deg", _RAD_PER_DEG)
    return scale * row.number(key)


def drawn_truth(arm: ArmModel, seed: int, select: Sequence[str] = ()) -> dict[str, float]:
    """True parameters that depart from nominal at random.

    Standard deviations: 0.75° of encoder offsets, 1 mm of lengths, 0.1° of tilts.

    Args:
        arm: the nominal arm.
        seed: of the errors.
        select: names and globs of the parameters that depart; by default the encoder offsets and
            the lengths of the links, which is what a first calibration looks for.

    Returns:
        Values of all the arm's parameters, m or rad.

    Raises:
        ParameterError: a name that selects nothing.
    """
    names = arm.select(*select).names if select else _usual(arm)
    rows = tuple(
        ErrorRow(
            (name,), {}, _OFFSET_STD if arm.offered[name].key in (OFFSET, *POSITION) else _TILT_STD
        )
        for name in names
    )
    return true_values(arm, _only_errors(arm, rows), seed)


def error_rows(arm: ArmModel, values: Mapping[str, float]) -> tuple[ErrorRow, ...]:
    """What a simulation's ``errors`` would say for the arm to have these values, m or rad."""
    nominal = arm.parameters
    return tuple(
        ErrorRow((name,), {nominal[name].unit: value - nominal[name].nominal}, {})
        for name, value in values.items()
        if value != nominal[name].nominal
    )


def _usual(arm: ArmModel) -> tuple[str, ...]:
    return tuple(
        name
        for name, parameter in arm.parameters.items()
        if parameter.key == OFFSET
        or (name in arm.geometric and parameter.key in POSITION and parameter.nominal)
    )


def _only_errors(arm: ArmModel, rows: tuple[ErrorRow, ...]) -> SimulationSpec:
    chain = arm.chain
    return SimulationSpec(chain.path, chain.path, chain.tip, chain.base, 0, (), rows, ())
