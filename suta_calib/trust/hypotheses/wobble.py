"""A joint axis that wobbles: a bearing out of true tilts the axis with the joint's angle."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ROTATION
from suta_calib.trust import AddedVariable, Effect, Evidence, Examination, SpoiltData, Truth
from suta_calib.trust.simulated_faults import arm_of, displaced
from suta_calib.units import from_deg, text, with_std


class Wobble(AddedVariable):
    """A turn about the two axes across the joint, as cos and sin of q or 2q: four numbers.

    No parameter describes it, so that nothing can be freed. Its effect at the tip is stated.
    """

    name = "axis wobble"
    about = "The axis of a joint tilts once or twice a turn."

    def effects(self, answer: Examination) -> Iterator[Effect]:
        """One for each revolute joint and harmonic."""
        arm = answer.arm
        assert arm is not None
        # How often in a turn of the joint the axis tilts. Once is a bearing ring that is tilted in
        # its seat: in the frame of the link it is a constant, which the geometry takes up in part.
        harmonics = {1: "once", 2: "twice"}
        # A bearing that tilts its axis by more would be seen.
        plausible = from_deg(0.5)
        for k, joint in enumerate(arm.joints):
            across = _across(answer, joint)
            if arm.units[joint] != "rad" or across is None:
                continue
            for harmonic, often in harmonics.items():
                waves = _waves(harmonic * answer.q[:, k])
                velocity = np.einsum("nvu,nw->nvuw", across, waves).reshape(len(waves), 6, 4)
                yield Effect(
                    f"{joint} {often} a turn",
                    answer.by_motion(velocity),
                    np.full(4, plausible),
                    about=(joint, often, velocity),
                )

    def sentence(self, evidence: Evidence) -> str:
        """The joint, the tilt of its axis, and the effect at the tip."""
        joint, often, velocity = evidence.effect.about
        size, std = evidence.length()
        at_tip = np.sqrt(np.mean(np.sum((velocity[:, :3] @ evidence.size) ** 2, axis=1)))
        return (
            f"The residuals look like an axis of {joint} that wobbles {often} a turn, by "
            f"{with_std(size, std, 'rad')}. This moves the tip by "
            f"{text(float(at_tip), 'm', with_unit=True)} (RMS) in these postures. No parameter "
            "describes it, and ± includes it only if there are validation data that show it. Check "
            "the bearing of this joint."
        )

    def spoil(self, data: Any, values: Truth, rng: np.random.Generator) -> SpoiltData:
        """An axis that tilts by 0.1° twice a turn."""
        arm = arm_of(data)
        joint = str(rng.choice([j for j in arm.own_joints if arm.units[j] == "rad"][:-1]))
        q = data.poses.samples.q
        size = from_deg(0.1) * np.array([0.6, 0.0, 0.0, 0.8])
        across = _turned(arm, joint, q, values)
        waves = _waves(2.0 * q[:, arm.joints.index(joint)])
        twist = np.einsum("nvu,nw,uw->nv", across, waves, size.reshape(2, 2))
        return SpoiltData(displaced(data, values, twist), size, f"{joint} twice a turn")


def _waves(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _across(answer: Examination, joint: str) -> FloatArray | None:
    """(samples, 6, 2) velocity of the tip by turns about the two axes across a joint.

    The joint's placement turns about axes that stand still while the joint moves.
    """
    names = [f"{joint}.{key}" for key in ROTATION]
    unknowns = answer.problem.names
    arm = answer.arm
    assert arm is not None
    if not all(name in unknowns for name in names) or joint not in arm.read_from:
        return None
    columns = [unknowns.index(name) for name in names]
    velocity = answer.table.velocity[:, columns].reshape(-1, 6, 3)
    mover = [segment.owner for segment in arm.movers].index(joint)
    return _beside_axis(velocity, answer.motion[:, 3:, mover])


def _beside_axis(velocity: FloatArray, axis: FloatArray) -> FloatArray:
    """Two of three turns (samples, 6, 3), combined so that both are across an axis (samples, 3)."""
    # The axis in the frame of the turns, which is the same in every sample.
    along = np.mean(np.einsum("nvu,nv->nu", velocity[:, 3:], axis), axis=0)
    beside = np.eye(3)[(int(np.abs(along).argmax()) + 1) % 3]
    first = np.cross(along, beside)
    second = np.cross(along, first)
    both = np.stack([v / max(float(np.linalg.norm(v)), 1e-300) for v in (first, second)], axis=1)
    return np.asarray(velocity @ both)


def _turned(arm: ArmModel, joint: str, q: FloatArray, values: Mapping[str, float]) -> FloatArray:
    """`_across` of an arm at readings, by differences."""
    step, base = 1e-6, dict(values)

    def pose(moved: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        return arm.forward(q, base | dict(moved))

    rotation, position = pose({})

    def velocity(name: str) -> FloatArray:
        nominal = arm.offered[name].nominal
        turned, shifted = pose({name: base.get(name, nominal) + step})
        turn = turned @ np.swapaxes(rotation, 1, 2)
        axis = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
        return np.hstack([(shifted - position) / step, axis / step])

    turns = np.stack([velocity(f"{joint}.{key}") for key in ROTATION], axis=2)
    return _beside_axis(turns, velocity(f"{joint}.offset")[:, 3:])
