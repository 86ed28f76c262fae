"""From a script to an arm that rests on one landmark after the other.

Where the arm rests is what `suta_calib.simulation` finds for the same placements, noise and seed;
only the encoders' noise is left to the stream.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arm_keys import ArmSpec
from suta_calib.arrays import FloatArray
from suta_calib.emulation.motion import Stops, continuous
from suta_calib.emulation.trajectories import posture_of
from suta_calib.emulation.truth import error_rows
from suta_calib.errors import InputError, JobError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.job.outline import JobOutline
from suta_calib.measurements import Artefact, YamlSection, read_artefact, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import (
    InverseKinematics,
    NoiseLevels,
    PoseSpec,
    SetSpec,
    SimulatedFile,
    SimulationSpec,
    Targets,
    read_simulation,
    simulate,
)
from suta_calib.simulation.noise import full_circle, stream
from suta_calib.simulation.schema import PostureRow
from suta_calib.terms import first_kind
from suta_calib.terms.landmark import seated
from suta_calib.units import from_deg, from_mm

SEATING: Final = NoiseLevels(seating=5e-5)
PLACE_FORM: Final = "LABEL=x,y,z or LABEL=x,y,z,roll,pitch,yaw in mm and degrees"


@dataclass(frozen=True)
class Timing:
    """How long each rest and each motion between two rests lasts, s."""

    rest: float = 4.0
    move: float = 1.5


def artefact_set(
    artefact: Path,
    placements: Mapping[str, PoseSpec],
    repeats: int = 1,
    noise: NoiseLevels = SEATING,
) -> SetSpec:
    """An artefact's file to be gone through ``repeats`` times at each ``T_base_artefact``.

    Seated to 50 µm per axis by default.
    """
    kind = first_kind(artefact=True).kind
    return SetSpec("script", kind, noise, artefact=artefact, places=placements, repeats=repeats)


def point_set(
    points: Mapping[str, PoseSpec],
    directions: int = 20,
    cone: float = SetSpec.cone,
    noise: NoiseLevels = SEATING,
) -> SetSpec:
    """Fixed points, in the base, each to be touched from so many directions.

    The tip's z axis is at most ``cone``, rad, from straight down; seated to 50 µm by default.
    """
    kind = first_kind(artefact=False).kind
    return SetSpec("script", kind, noise, places=points, directions=directions, cone=cone)


def stops(
    arm: ArmModel,
    values: Mapping[str, float],
    plan: SetSpec,
    *,
    seed: int = 0,
    sequence: Sequence[str] = (),
    posture: Sequence[PostureRow] = (),
    timing: Timing | None = None,
    path: Path | None = None,
) -> Stops:
    """The rests and motions of an arm that goes through a set of landmarks or points.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        plan: what is touched, and how well it is seated.
        seed: of seating and directions.
        sequence: order of the landmarks; that of the artefact's file by default.
        posture: readings from which the search for postures begins.
        timing: of rests and motions.
        path: the script's file, for messages.

    Raises:
        JobError: a landmark or point is out of the true arm's reach; says how far.
        InputError: a landmark in ``sequence`` that the artefact does not have.
    """
    chain, timing = arm.chain, timing or Timing()
    # What the encoders add belongs to the stream.
    noise = replace(plan.noise, encoder_angle=0.0, encoder_length=0.0, encoder_bits=0)
    exact = replace(plan, noise=noise)
    spec = SimulationSpec(
        path or chain.path,
        ArmSpec(chain.path, chain.tip, chain.base),
        seed,
        posture=tuple(posture),
        errors=error_rows(arm, values),
        sets=(exact,),
    )
    order = _order(plan, sequence)
    rounds = [one for file in simulate(spec).files for one in _rounds(file, order)]
    postures = np.concatenate([file.samples.q[rows] for file, rows in rounds])
    labels = tuple(
        {name: str(values[row]) for name, values in file.samples.labels.items()}
        for file, rows in rounds
        for row in rows
    )
    ends = tuple((np.cumsum([len(rows) for _, rows in rounds]) - 1).tolist())
    return Stops(continuous(postures, full_circle(arm)), labels, timing.rest, timing.move, ends)


def _order(plan: SetSpec, sequence: Sequence[str]) -> tuple[str, ...]:
    """Landmarks in the order in which they are gone through; empty for fixed points."""
    if plan.artefact is None:
        if sequence:
            raise InputError("a sequence of landmarks although the job has fixed points", "none")
        return ()
    landmarks = tuple(read_artefact(plan.artefact).landmarks)
    if (name := next((name for name in sequence if name not in landmarks), None)) is not None:
        raise InputError(
            f"no landmark {name!r}",
            f"names of {', '.join(landmarks)}",
            file=plan.artefact,
            where="sequence",
            hint=did_you_mean(name, landmarks),
        )
    return tuple(sequence) or landmarks


def _rounds(file: SimulatedFile, order: tuple[str, ...]) -> list[tuple[SimulatedFile, list[int]]]:
    """Rows of a file, one list for each time it is gone through."""
    labels = file.samples.labels
    if not order:
        return [(file, list(range(len(file.samples))))]
    row_of = {
        (str(repeat), str(name)): row
        for row, (repeat, name) in enumerate(zip(labels["repeat"], labels["landmark"], strict=True))
    }
    repeats = dict.fromkeys(str(value) for value in labels["repeat"])
    return [(file, [row_of[repeat, name] for name in order]) for repeat in repeats]


def parse_pose(text: str, where: str = "") -> tuple[str, PoseSpec]:
    """``P1=x,y,z[,roll,pitch,yaw]`` in mm and degrees, as a label and a pose in SI units."""
    label, equals, rest = text.partition("=")
    try:
        numbers = [float(number) for number in rest.split(",")]
    except ValueError:
        numbers = []
    usable = len(numbers) in (3, 6) and np.isfinite(numbers).all()
    if not (equals and label.strip() and usable):
        raise InputError(repr(text), PLACE_FORM, where=where)
    rotation = rotation_from_rpy(from_deg(np.array(numbers[3:]))) if numbers[3:] else np.eye(3)
    return label.strip(), PoseSpec(rotation, from_mm(np.array(numbers[:3])))


def read_script(path: Path) -> JobOutline | SimulationSpec:
    """Read a script, a ``calibration.yaml`` or a ``simulation.yaml``.

    Raises:
        JobError: the file cannot be read, or is neither a job nor a simulation; names the line
            and the key.
    """
    top = YamlSection(read_yaml(Path(path), JobError), JobError)
    if "sets" in top:
        return read_simulation(path)
    if "observations" not in top:
        raise top.refuse(
            "neither a job nor a simulation",
            "'observations' as in a calibration.yaml, or 'sets' as in a simulation.yaml",
        )
    return JobOutline.of(top)


def placement_within_reach(
    arm: ArmModel,
    values: Mapping[str, float],
    artefact: Path,
    label: str,
    *,
    posture: FloatArray | None = None,
    seed: int = 0,
) -> PoseSpec:
    """An upright pose of an artefact, drawn at random, in which every landmark can be reached.

    Args:
        arm: the nominal arm.
        values: its true parameters, m or rad.
        artefact: the artefact's file.
        label: of the placement; others are drawn for other labels.
        posture: (joints,) readings about which it is looked for; the middle of the ranges.
        seed: of the pose.

    Raises:
        JobError: none was found.
    """
    tries = 300
    rng = stream(seed, label, "placement")
    kinematics = InverseKinematics(arm, values)
    start = posture_of(arm) if posture is None else posture
    read = read_artefact(artefact)
    centre = np.mean([mark.position for mark in read.landmarks.values()], axis=0)
    near = start + 0.4 * (kinematics.random_readings(rng, tries) - start)
    _, tips = arm.forward(near, values)
    for tip in tips:
        rotation = rotation_from_rpy([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        # Rounded to what somebody would write down, and not below the table the arm stands on.
        position = np.round(tip - rotation @ centre, 4)
        pose = PoseSpec(rotation, np.array([*position[:2], max(0.0, position[2])]))
        # One after the other, for most poses fail at the first.
        targets = _landmark_targets(read, pose)
        if all(kinematics.solve(target, start, rng, 3).reached[0] for target in targets):
            return pose
    raise JobError(
        f"no suitable position for placement {label!r} in {tries} tries",
        "an upright pose with every landmark within reach",
        file=artefact,
        hint=f"give its pose: --placement {label}=x,y,z,roll,pitch,yaw in mm and degrees",
    )


def _landmark_targets(artefact: Artefact, pose: PoseSpec) -> Iterator[Targets]:
    """Where the tip is on each landmark, those with an orientation first."""
    marks = sorted(artefact.landmarks.values(), key=lambda mark: mark.rotation is None)
    tips = seated(artefact, [mark.name for mark in marks], pose.rotation, pose.position)
    assert tips.rotation is not None
    for mark, p, R in zip(marks, tips.place, tips.rotation, strict=True):
        yield Targets(p[None], R[None], "position" if mark.rotation is None else "pose")
