"""The truth behind an emulated arm: read from a file or drawn, and what is left of it in files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arm_keys import ArmSpec
from suta_calib.emulation.motion import Motion, Stops
from suta_calib.emulation.player import TrueTrajectory
from suta_calib.errors import JobError, did_you_mean
from suta_calib.geometry.numbers import quaternion_from_rotation, rpy_from_rotation
from suta_calib.measurements import YamlSection, read_yaml, write_text
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import OFFSET, POSITION, Parameter
from suta_calib.model.robot import AnyArm
from suta_calib.simulation import ErrorRow, SetSpec, SimulationSpec, read_simulation, true_values
from suta_calib.units import deg, key, mm, shown, stored


def nominal_values(arm: AnyArm) -> dict[str, float]:
    """Every parameter of the arm at nominal, m or rad."""
    return {name: parameter.nominal for name, parameter in arm.parameters.items()}


def read_truth(path: Path, arm: AnyArm, seed: int | None = None) -> dict[str, float]:
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
        seed = spec.seed if seed is None else seed
        if spec.arm.chains and isinstance(arm, ArmModel):
            # Its errors may name joints of the other chains.
            drawn = true_values(spec.arm.mechanism(), spec, seed)
            return {name: value for name, value in drawn.items() if name in arm.offered}
        return true_values(spec.arm.with_offsets(arm), spec, seed)
    if "parameters" not in top or isinstance(top.data["parameters"], list):
        raise top.refuse(
            "neither a truth.yaml nor a simulation.yaml",
            "a mapping 'parameters' of true values, or 'errors' together with 'sets'",
            at=("parameters",),
        )
    listed = top.section("parameters") if top.data["parameters"] else None
    return nominal_values(arm) | ({} if listed is None else _values(listed, arm))


def _values(listed: YamlSection, arm: AnyArm) -> dict[str, float]:
    values = {}
    for name in listed.data:
        if name not in arm.offered:
            raise listed.refuse(
                "a parameter that the arm does not have",
                "parameters of this arm",
                at=(name,),
                hint=did_you_mean(name, arm.offered),
            )
        unit = arm.offered[name].unit
        values[name] = stored(listed.section(name).number(key("value", unit)), unit)
    return values


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
    # Sizes of drawn errors: those of a well-made arm whose encoders were set by eye.
    offset_std, tilt_std = {"rad": 0.013, "m": 1e-3}, {"rad": 0.0017}

    def usual(parameter: Parameter) -> bool:
        length = parameter.name in arm.geometric and parameter.key in POSITION
        return parameter.key == OFFSET or bool(length and parameter.nominal)

    drawn = arm.select(*select) if select else arm.parameters
    rows = tuple(
        ErrorRow((p.name,), {}, offset_std if p.key in (OFFSET, *POSITION) else tilt_std)
        for p in drawn.values()
        if select or usual(p)
    )
    chain = arm.chain
    only_errors = SimulationSpec(
        chain.path, ArmSpec(chain.path, chain.tip, chain.base), 0, (), errors=rows, sets=()
    )
    return true_values(arm, only_errors, seed)


def error_rows(arm: ArmModel, values: Mapping[str, float]) -> tuple[ErrorRow, ...]:
    """What a simulation's ``errors`` would say for the arm to have these values, m or rad."""
    nominal = arm.parameters
    return tuple(
        ErrorRow((name,), {nominal[name].unit: value - nominal[name].nominal}, {})
        for name, value in values.items()
        if value != nominal[name].nominal
    )


_TRUTH_HEADING: Final = (
    "The true values behind an emulated arm, for judging a calibration. Nothing here "
    "was\nmeasured. Parameters that are not listed are nominal."
)


def truth_text(
    arm: ArmModel,
    values: Mapping[str, float],
    seed: int,
    plan: SetSpec | None = None,
    motion: Motion | None = None,
) -> str:
    """``truth.yaml``, as `suta_calib.simulation` writes it, and what a script's arm touches."""
    parameters = {}
    for name, value in values.items():
        parameter = arm.parameters[name]
        if value != parameter.nominal:
            unit = parameter.unit
            error = round(shown(value - parameter.nominal, unit), 9)
            row = {key("value", unit): shown(value, unit), key("error", unit): error}
            parameters[name] = row
    document: dict[str, Any] = {"simulated": True, "seed": seed, "parameters": parameters}
    if plan is not None:
        document[plan.places_key] = {
            name: {
                "position_mm": _rounded(mm(pose.position)),
                "rotation_rpy_deg": _rounded(deg(rpy_from_rotation(pose.rotation))),
            }
            for name, pose in plan.places.items()
        }
    if isinstance(motion, Stops):
        document["rests"] = [
            {"arrival_s": round(motion.arrival(k), 6), **labels}
            for k, labels in enumerate(motion.labels)
        ]
    return yaml_text(document, _TRUTH_HEADING)


def write_trajectory(
    path: Path,
    arm: ArmModel,
    values: Mapping[str, float],
    trajectory: TrueTrajectory,
    motion: Motion | None = None,
) -> None:
    """Write a CSV file: ``time`` (s), true tip pose (m, quaternion x y z w), true readings (rad).

    A script adds the labels of the rest the arm is on, empty while it moves.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    rotation, position = arm.forward(trajectory.q, values)
    quaternion = quaternion_from_rotation(rotation)
    numbers = np.column_stack([position, quaternion, trajectory.q])
    labels: dict[str, list[str]] = {}
    if isinstance(motion, Stops):
        stops = motion.resting_on(trajectory.motion_time)
        labels = {
            name: ["" if np.isnan(stop) else motion.labels[int(stop)][name] for stop in stops]
            for name in motion.labels[0]
        }
    header = ["time", "x", "y", "z", "qx", "qy", "qz", "qw", *arm.joints, *labels]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for k, (time, row) in enumerate(zip(trajectory.time.tolist(), numbers.tolist(), strict=True)):
        cells = [f"{value:.12g}" for value in row]
        writer.writerow([f"{time:.6f}", *cells, *(column[k] for column in labels.values())])
    write_text(path, text.getvalue())


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 9) + 0.0 for value in values]
