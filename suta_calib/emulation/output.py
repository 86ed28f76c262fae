"""What an emulated arm leaves behind: its device.yaml, its truth, its true trajectory."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from suta_calib.device.description import DeviceSpec
from suta_calib.emulation.motion import Motion, Stops
from suta_calib.emulation.recorder import TrueTrajectory
from suta_calib.geometry.numbers import quaternion_from_rotation, rpy_from_rotation
from suta_calib.measurements import write_text
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import SetSpec
from suta_calib.units import deg, key, mm, shown

_DEVICE_HEADING: Final = "# An emulated arm: there is no hardware behind this port.\n"
_TRUTH_HEADING: Final = (
    "# Simulated: the truth behind an emulated arm, for judging a calibration. Nothing here was\n"
    "# measured. Parameters that are not listed are nominal.\n"
)


def device_text(device: DeviceSpec) -> str:
    """``device.yaml`` of a device."""
    document: dict[str, Any] = {
        "port": device.port,
        "baudrate": device.baudrate,
        "format": device.format,
        "unit": device.unit,
        "counts_per_turn": device.counts_per_turn,
        "joints": [_row({"name": joint.name, "sign": joint.sign}) for joint in device.joints],
    }
    return _DEVICE_HEADING + _yaml(document)


def truth_text(
    arm: ArmModel,
    values: Mapping[str, float],
    seed: int,
    plan: SetSpec | None = None,
    motion: Motion | None = None,
) -> str:
    """``truth.yaml``, as `suta_calib.simulation` writes it, and what the arm touches.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        seed: of the emulation.
        plan: what is touched, for a script.
        motion: the rests of a script.
    """
    nominal = arm.parameters
    departing = {n: v for n, v in values.items() if v != nominal[n].nominal}
    document: dict[str, Any] = {
        "simulated": True,
        "seed": seed,
        "parameters": {name: _parameter(arm, name, value) for name, value in departing.items()},
    }
    if plan is not None:
        document[plan.places_key] = {
            name: _row(
                {
                    "position_mm": _rounded(mm(pose.position)),
                    "rotation_rpy_deg": _rounded(deg(rpy_from_rotation(pose.rotation))),
                }
            )
            for name, pose in plan.places.items()
        }
    if isinstance(motion, Stops):
        document["rests"] = [
            _row({"arrival_s": round(motion.arrival(k), 6), **labels})
            for k, labels in enumerate(motion.labels)
        ]
    return _TRUTH_HEADING + _yaml(document)


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
    labels = _resting(motion, trajectory)
    header = ["time", "x", "y", "z", "qx", "qy", "qz", "qw", *arm.joints, *labels]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    for k, (time, row) in enumerate(zip(trajectory.time.tolist(), numbers.tolist(), strict=True)):
        cells = [f"{value:.12g}" for value in row]
        writer.writerow([f"{time:.6f}", *cells, *(column[k] for column in labels.values())])
    write_text(path, text.getvalue())


def _resting(motion: Motion | None, trajectory: TrueTrajectory) -> dict[str, list[str]]:
    """Label columns of a script."""
    if not isinstance(motion, Stops):
        return {}
    stop = motion.resting_on(trajectory.motion_time)
    numbers = [None if np.isnan(each) else int(each) for each in stop]
    names = list(motion.labels[0])
    return {name: ["" if k is None else motion.labels[k][name] for k in numbers] for name in names}


def _parameter(arm: ArmModel, name: str, value: float) -> CommentedMap:
    unit, nominal = arm.parameters[name].unit, arm.parameters[name].nominal
    error = round(shown(value - nominal, unit), 9)
    return _row({key("value", unit): shown(value, unit), key("error", unit): error})


def _row(values: dict[str, Any]) -> CommentedMap:
    """A mapping that is written on one line."""
    row = CommentedMap(values)
    row.fa.set_flow_style()
    return row


def _rounded(values: np.ndarray) -> CommentedSeq:
    return CommentedSeq([round(float(value), 9) + 0.0 for value in values])


def _yaml(document: dict[str, Any]) -> str:
    yaml, text = YAML(), io.StringIO()
    yaml.width = 1000
    yaml.dump(document, text)
    return text.getvalue()
