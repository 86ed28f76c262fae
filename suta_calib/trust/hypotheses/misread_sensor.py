"""A tilt sensor of the arm that shows something else than the lean of its link."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.tilt import TURN
from suta_calib.solver.problem import Problem
from suta_calib.terms.poses import ArmPoses
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.leans import lean_of, moved_by, tip_moved
from suta_calib.trust.simulated_faults import arm_of, with_columns
from suta_calib.units import text


class MisreadSensor(AddedVariable):
    """The link leans by A l in place of l, what was felt: A - 1 are four numbers.

    Two of them turn and scale l about "up"; two do so to l as in a mirror. A sensor whose axes are
    left-handed has the mirror alone, one that is too noisy, or sits on another link, less than l.
    """

    name = "misread tilt sensor"
    about = "A tilt sensor of the arm has left-handed axes, too much noise, or is on another link."
    before_others = True

    def applies(self, problem: Problem) -> bool:
        """Where the arm has such a sensor."""
        arm = problem.arm
        return arm is not None and bool(arm.tilt_sensors) and super().applies(problem)

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each sensor."""
        assert answer.arm is not None
        for sensor in answer.arm.tilt_sensors:
            velocity = np.zeros((len(answer.position), 6, 4))
            for k, term in enumerate(answer.problem.terms):
                poses, rows = term.poses, slice(*answer.boundaries[k : k + 2])
                if not isinstance(poses, ArmPoses) or sensor.felt not in poses.samples.felt:
                    continue
                links = [s.link for s in poses.arm.tilt_sensors]
                if sensor.link not in links:
                    continue
                lean, rotation, at = lean_of(answer, poses, sensor.felt, sensor.link)
                reached, turns = answer.position[rows], 1.0
                for link in links[links.index(sensor.link) + 1 :][:1]:
                    # The next sensor takes back what turns its link.
                    _, reached = poses.arm.link_poses(link, poses.samples.q)
                    turns = 0.0
                # Any axis of the link across the vertical: others are this one, turned.
                mirrored = rotation @ _across(np.array(sensor.upright))
                flipped = lean - 2.0 * mirrored * np.sum(lean * mirrored, axis=1)[:, None]
                both = [moved_by(poses.arm, each, reached - at) for each in (lean, flipped)]
                velocity[rows] = np.concatenate(both, axis=2)
                velocity[rows, 3:] *= turns
            (turn,) = sensor.names(TURN)
            about = (sensor.link, velocity, answer.solution.values.get(turn, 0.0))
            yield Effect(sensor.link, answer.by_motion(velocity), np.full(4, 2.0), about=about)

    def sentence(self, evidence: Evidence) -> str:
        """Which sensor, what is wrong with it, and what to do."""
        link, velocity, turn = evidence.effect.about
        about, across = evidence.size[:2]
        turned = float(np.hypot(np.cos(turn) + about, np.sin(turn) + across))
        mirrored = float(np.hypot(*evidence.size[2:]))
        tip = text(tip_moved(velocity, evidence.size), "m", with_unit=True)
        if mirrored > turned:
            cause = (
                "that is mirrored: its axes are left-handed. Change the sign of one of its "
                "columns, or exchange two of them"
            )
        else:
            cause = (
                f"of which {turned:.0%} shows at the tip. Check whether the sensor is noisy, "
                "whether it is on this link, and whether its readings are of the same rows"
            )
        return (
            f"The residuals do not agree with the tilt sensor of {link}: it felt a lean {cause}. "
            f"This moves the tip by {tip} (RMS)."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """Left-handed axes of the first sensor."""
        felt = dict(data.poses.samples.felt)
        name = arm_of(data).tilt_sensors[0].felt
        felt[name] = felt[name] * [-1.0, 1.0, 1.0]
        return SpoiltData(with_columns(data, felt=felt), np.full(4, np.nan))


def _across(upright: FloatArray) -> FloatArray:
    across = np.cross(upright, np.eye(3)[np.argmin(np.abs(upright))])
    return np.asarray(across / np.linalg.norm(across))
