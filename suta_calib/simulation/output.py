"""Writes simulated samples, with their true values and a note that they are simulated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.atomic import refuse_inputs
from suta_calib.errors import OutputError
from suta_calib.geometry.numbers import homogeneous, quaternion_from_rotation, rpy_from_rotation
from suta_calib.measurements import write_corners, write_samples, write_text
from suta_calib.measurements.profiles import Profiles, write_profiles
from suta_calib.measurements.sample_files import has_no_rows
from suta_calib.measurements.yaml_text import yaml_text
from suta_calib.model.parameters import POSITION
from suta_calib.simulation.motion import MotionSpec
from suta_calib.simulation.protocol import TruePose
from suta_calib.simulation.schema import SetSpec
from suta_calib.simulation.simulated import SimulatedFile, Simulation
from suta_calib.units import deg, key, mm, ms, shown, us

_TITLE: Final = "# Simulated measurements"
_TRUTH_HEADING: Final = (
    "Simulated: the true values behind the simulated samples in this folder, for judging a\n"
    "calibration. Nothing here was measured. Parameters that are not listed are nominal."
)


def write_simulation(simulation: Simulation, folder: Path) -> list[Path]:
    """Write the samples, ``truth.yaml`` and ``README.md`` into a folder, made where needed.

    The samples files of a new job that are `still_empty` there are removed.

    Returns:
        The files written.

    Raises:
        OutputError: a file cannot be written, is an input of the same command, would replace a
            README of somebody else's, or would lie beside samples of another origin that a glob
            would then read too.
    """
    folder = Path(folder)
    _check_readme(folder / "README.md")
    detected = [each for file in simulation.files for each in (file.corners, file.profiles) if each]
    written = [
        *(file.path for file in simulation.files),
        *(name for name, _ in detected),
        *("truth.yaml", "README.md"),
    ]
    # Before the first of them is written.
    empty = still_empty(simulation, folder)
    refuse_inputs(dict.fromkeys([*(folder / name for name in written), *empty]))
    _check_strangers([path for path in _other_files(simulation, folder) if path not in empty])
    for path in empty:
        try:
            path.unlink()
        except OSError as problem:
            raise OutputError(f"{path}: not removed: {problem.strerror}") from problem
    for file in simulation.files:
        path = folder / file.path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise OutputError(f"{path.parent}: not created: {problem.strerror}") from problem
        write_samples(path, file.samples)
    for name, content in detected:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, Profiles):
            write_profiles(folder / name, content)
        else:
            write_corners(folder / name, content)
    write_text(folder / "truth.yaml", truth_text(simulation))
    write_text(folder / "README.md", _readme(simulation))
    return [folder / name for name in written]


def truth_text(simulation: Simulation) -> str:
    """``truth.yaml``: seed, true parameters, landmarks, poses outside the arm and outliers.

    In mm and degrees; 4x4 matrices in metres.
    """
    sets, parameters = simulation.spec.sets, {}
    # Not where the URDF has it, so that its readers need the values though they are right.
    tips = simulation.spec.arm.tips.items()
    tip = [f"{name}.{k}" for name, offset in tips if offset is not None for k in POSITION]
    for name, value in simulation.values.items():
        nominal, unit = simulation.arm.offered[name].nominal, simulation.arm.offered[name].unit
        if value != nominal or name in tip:
            error = round(shown(value - nominal, unit), 9)
            row = {key("value", unit): shown(value, unit), key("error", unit): error}
            parameters[name] = row
    # True positions, where they depart from the certified ones.
    landmarks = {
        plan.name: {
            mark.name: {"position_mm": mm(mark.position).tolist()}
            for mark in simulation.artefacts[plan.name].landmarks.values()
        }
        for plan in sets
        if plan.noise.artefact and plan.name in simulation.artefacts
    }
    # How the tip always sits, where it does not fit.
    seatings = {
        plan.name: {"x_mm": mm(x), "y_mm": mm(y), "rz_deg": deg(rz)}
        for plan in sets
        for x, y, rz in [plan.seating]
        if any(plan.seating)
    }
    offsets = {p.name: _clock_row(p, p.motion) for p in sets if p.motion is not None}
    outside = {
        name: {pose.frame.owner: _pose_row(pose) for pose in poses}
        for name, poses in simulation.outside.items()
        if poses
    }
    document = {
        "simulated": True,
        "simulation": simulation.spec.path.name,
        "seed": simulation.seed,
        "parameters": parameters,
        "landmarks": landmarks,
        **({"seating": seatings} if seatings else {}),
        **({"time_offsets": offsets} if offsets else {}),
        **({"external_poses": outside} if outside else {}),
        "outliers": [row for file in simulation.files for row in _outliers(file)],
    }
    return yaml_text(document, _TRUTH_HEADING)


def _clock_row(plan: SetSpec, motion: MotionSpec) -> dict[str, float]:
    """How late observations are, and of a rolling shutter how long a row takes."""
    row, delay = {"offset_ms": ms(motion.time_offset)}, plan.settings.get("line_delay")
    return row if delay is None else {**row, "line_delay_us": us(delay.value)}


def _pose_row(pose: TruePose) -> dict[str, Any]:
    """With the keys of a result's ``external_poses``."""
    numbers = {"position_mm": mm(pose.position)}
    if (rotation := pose.rotation) is not None:
        numbers |= {
            "rpy_deg": deg(rpy_from_rotation(rotation)),
            "quaternion_xyzw": quaternion_from_rotation(rotation),
            "matrix": homogeneous(rotation, pose.position),
        }
    # Without what rounding leaves of a zero, or its sign.
    pose_numbers = {name: (np.round(x, 12) + 0.0).tolist() for name, x in numbers.items()}
    return {"what": pose.frame.what, "within": pose.frame.within, **pose_numbers}


def _outliers(file: SimulatedFile) -> list[dict[str, Any]]:
    labels = file.samples.labels
    return [
        {
            "file": file.path,
            "line": int(file.samples.origin[row].rpartition(":")[2]),
            **{name: str(values[row]) for name, values in labels.items()},
            "displacement_mm": [round(x, 6) for x in mm(file.displacement[row]).tolist()],
        }
        for row in map(int, file.outliers)
    ]


def _readme(simulation: Simulation) -> str:
    name = simulation.spec.path.name
    text = (
        f"{_TITLE}\n\n"
        f"Everything listed here is simulated: no arm was touched. It was made from `{name}` "
        f"with seed {simulation.seed} by\n"
        f"`suta-calib simulate {name} --out .`, which replaces these files and this page.\n"
        "`truth.yaml` holds the true parameters and says which rows are outliers.\n\n"
    )
    return text + "".join(f"- `{f.path}`: {len(f.samples)} samples\n" for f in simulation.files)


def _check_readme(path: Path) -> None:
    try:
        foreign = path.exists() and not path.read_text("utf-8", "replace").startswith(_TITLE)
    except OSError as problem:
        raise OutputError(f"{path}: not readable: {problem.strerror}") from problem
    if foreign:
        raise OutputError(
            f"{path}: found a page not written by a simulation; expected none, or one that begins "
            f"with '{_TITLE}'; choose another --out"
        )


def _other_files(simulation: Simulation, folder: Path) -> list[Path]:
    """Samples files that lie where a simulation's will, and are none of them."""
    ours = {folder / file.path for file in simulation.files}
    return sorted({path for mine in ours for path in mine.parent.glob("*.csv")} - ours)


def still_empty(simulation: Simulation, folder: Path) -> list[Path]:
    """Which of the other samples files, where a simulation's will be, hold a header and no data.

    Such as those that a new job begins with. Nothing is lost with them, and a job whose glob finds
    one of them beside the simulated ones would warn of it in every run.
    """
    return [path for path in _other_files(simulation, Path(folder)) if _is_empty(path, simulation)]


def _is_empty(path: Path, simulation: Simulation) -> bool:
    # A file of another table may be worth keeping.
    if not has_no_rows(path):
        return False
    columns = {*path.read_text("utf-8-sig").strip().split(",")}
    return any({*arm.own_joints} <= columns for arm in simulation.arm.arms)


def _check_strangers(strangers: Sequence[Path]) -> None:
    """Old samples would be read together with the new ones, and nobody would notice."""
    if strangers:
        folder = strangers[0].parent
        names = ", ".join(path.name for path in strangers if path.parent == folder)
        raise OutputError(
            f"{folder}: found {names}; expected only files that it writes itself; remove them or "
            "choose another --out"
        )
