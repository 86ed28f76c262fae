"""A link that sinks or bends, as an accelerometer felt of which the job says nothing."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.geometry.numbers import rms_length
from suta_calib.model.arm import ArmModel
from suta_calib.terms.poses import ArmPoses
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.leans import lean_of, moved_by, tip_moved
from suta_calib.trust.simulated_faults import arm_of, displaced, with_columns
from suta_calib.units import from_deg, text
from suta_calib.words import listed


class LeaningLink(AddedVariable):
    """The link turns by what was felt beyond the model: as felt, and turned by 90° about "up".

    Both together are a sensor that is turned in its link by any angle. It is tried on every link.
    """

    name = "leaning link"
    about = "A link sinks or bends, as columns of an accelerometer show that the job does not use."
    before_others = True

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each accelerometer and each link that it may be on."""
        # By which links lean that stand on the ground or bend. Of another link, which the joints
        # turn, the direction of a sensor differs by more.
        most = from_deg(3.0)
        sources = [t.poses for t in answer.problem.terms if isinstance(t.poses, ArmPoses)]
        used = {sensor.felt for poses in sources for sensor in poses.arm.tilt_sensors}
        felt = {name for poses in sources for name in poses.samples.felt}
        every = {poses.chain for poses in sources}
        for name in sorted(felt - used):
            having = [poses for poses in sources if name in poses.samples.felt]
            chains = {poses.chain for poses in having}
            # Of chains of which the others have no such columns.
            where = f" in the rows of chain {listed([*chains])}" if chains < every else ""
            links = (link for poses in having for link in _below(poses.arm))
            for link in dict.fromkeys(links):
                velocity = np.zeros((len(answer.position), 6, 2))
                leans = list[FloatArray]()
                for k, term in enumerate(answer.problem.terms):
                    poses, rows = term.poses, slice(*answer.boundaries[k : k + 2])
                    if not isinstance(poses, ArmPoses) or name not in poses.samples.felt:
                        continue
                    if link in _below(poses.arm):
                        lean, _, at = lean_of(answer, poses, name, link)
                        leans.append(lean)
                        velocity[rows] = moved_by(poses.arm, lean, answer.position[rows] - at)
                size = rms_length(np.vstack(leans))
                if size < most:
                    columns = answer.by_motion(velocity)
                    about = (name, link, velocity, size, where)
                    yield Effect(f"{name} on {link}", columns, np.full(2, 2.0), about=about)

    def sentence(self, evidence: Evidence) -> str:
        """Which columns on which link, the lean and what it does to the tip, and what to write."""
        name, link, velocity, size, where = evidence.effect.about
        tip = text(tip_moved(velocity, evidence.size), "m", with_unit=True)
        columns = ", ".join(name.split(","))
        lean = text(size, "rad", with_unit=True)
        return (
            f"The residuals{where} agree with the accelerometer in the columns {columns}, if it is "
            f"on the link {link}: it leans by {lean} (RMS about the mean), which moves the tip by "
            f"{tip}. Add to the arm of the job: tilt_sensors: [{{link: {link}, columns: "
            f"[{columns}]}}]."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """A base that leans by 0.1° about either axis, from row to row."""
        arm, poses = arm_of(data), data.poses
        lean = np.zeros((len(poses), 3))
        lean[:, :2] = from_deg(0.1) * rng.standard_normal((len(poses), 2))
        # The correction turns what the model has, upright, to where it was felt.
        felt = arm.up + np.cross(arm.up, lean)
        twist = moved_by(arm, lean, poses.at(values)[1])[:, :, 0]
        leaning = displaced(data, values, twist)
        return SpoiltData(with_columns(leaning, felt={"ax,ay,az": 9.81 * felt}), np.array([1.0, 0]))


def _below(arm: ArmModel) -> list[str]:
    """Links of a chain that a joint moves something on; of those that are one body, the last."""
    joints = arm.chain.joints
    return [] if joints[0].climbed else [joint.parent for joint in joints if joint.moving]
