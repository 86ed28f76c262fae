"""A link that sinks or bends, as an accelerometer felt of which the job says nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.measurements.felt import up_felt
from suta_calib.model.arm import ArmModel
from suta_calib.model.tilt import TiltSensor
from suta_calib.solver.sensor_mounts import agreeing
from suta_calib.terms.poses import ArmPoses
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.simulated_faults import arm_of, displaced, with_columns
from suta_calib.units import from_deg, text

# By which links lean that stand on the ground or bend, rad: of another link, which the joints turn,
# the direction of a sensor differs by more.
_MOST = from_deg(3.0)


class LeaningLink(AddedVariable):
    """The link turns by what was felt beyond the model: as felt, and turned by 90° about "up".

    Both together are a sensor that is turned in its link by any angle. It is tried on every link.
    """

    name = "leaning link"
    about = "A link sinks or bends, as columns of an accelerometer show that the job does not use."
    before_others = True

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each accelerometer and each link that it may be on."""
        sources = [term.poses for term in answer.problem.terms]
        felt = {name for s in sources for name in s.samples.felt if isinstance(s, ArmPoses)}
        used = {s.felt for p in sources if isinstance(p, ArmPoses) for s in p.arm.tilt_sensors}
        for name in sorted(felt - used):
            having = [
                (k, poses)
                for k, poses in enumerate(sources)
                if isinstance(poses, ArmPoses) and name in poses.samples.felt
            ]
            links = dict.fromkeys(link for _, poses in having for link in _upright_links(poses.arm))
            for link in links:
                velocity = np.zeros((len(answer.position), 6, 2))
                leans = list[FloatArray]()
                for k, poses in having:
                    if link in _upright_links(poses.arm):
                        rows = slice(*answer.boundaries[k : k + 2])
                        lean, at = _lean(answer, poses, name, link)
                        leans.append(lean)
                        velocity[rows] = _turned(poses.arm, lean, answer.position[rows] - at)
                size = rms_length(np.vstack(leans))
                if size < _MOST:
                    columns = answer.by_motion(velocity)
                    about = (name, link, velocity, size)
                    yield Effect(f"{name} on {link}", columns, np.full(2, 2.0), about=about)

    def sentence(self, evidence: Evidence) -> str:
        """Which columns on which link, the lean and what it does to the tip, and what to write."""
        name, link, velocity, size = evidence.effect.about
        moved = velocity[:, :3] @ evidence.size
        tip = text(rms_length(moved), "m", with_unit=True)
        columns = ", ".join(name.split(","))
        return (
            f"The residuals agree with the accelerometer in the columns {columns}, if it is on the "
            f"link {link}: it leans by {text(size, 'rad', with_unit=True)} (RMS about the mean), "
            f"which moves the tip by {tip}. Add to the arm of the job: tilt_sensors: [{{link: "
            f"{link}, columns: [{columns}]}}]."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A base that leans by 0.1° about either axis, from row to row."""
        arm, poses = arm_of(data), data.poses
        lean = np.zeros((len(poses), 3))
        lean[:, :2] = from_deg(0.1) * rng.standard_normal((len(poses), 2))
        # The correction turns what the model has, upright, to where it was felt.
        felt = arm.up + np.cross(arm.up, lean)
        twist = _turned(arm, lean, poses.at(values)[1])[:, :, 0]
        leaning = displaced(data, values, twist)
        return SpoiltData(with_columns(leaning, felt={"ax,ay,az": 9.81 * felt}), np.array([1.0, 0]))


def _upright_links(arm: ArmModel) -> list[str]:
    """Links of a chain that something stands on: all but the one that the tip is on."""
    return [] if arm.chain.joints[0].climbed else [*arm.links][:-1]


def _lean(
    answer: Examination, poses: ArmPoses, name: str, link: str
) -> tuple[FloatArray, FloatArray]:
    """By how much a link leans (n, 3), in the base, rad, about its mean; where it is (n, 3), m."""
    arm, felt = poses.arm, up_felt(poses.samples.felt[name])
    values = answer.problem.values(answer.x)
    of_arm = {n: v for n, v in values.items() if n in arm.offered}
    rotation, position = arm.link_poses(link, poses.samples.q, of_arm)
    there = felt.any(axis=1)
    sensor = TiltSensor(link)
    turn, mounts = agreeing(arm.up, {sensor: (rotation[there], felt[there])})
    shown = np.einsum("nij,jk,nk->ni", rotation, mounts[sensor], felt)
    return np.cross(shown, turn @ arm.up), position


def _turned(arm: ArmModel, lean: FloatArray, levers: FloatArray) -> FloatArray:
    """(n, 6, 2) what a lean (n, 3) does to a tip (n, 3) away: as it is, and turned about "up"."""
    both = np.stack([lean, np.cross(arm.up, lean)], axis=2)
    shift = np.cross(both, levers[:, :, None], axis=1)
    return np.concatenate([shift, both], axis=1)
