"""Chains between any two links of a tree, and joints that follow others, against Pinocchio.

Pinocchio sees the whole robot from its root; where the base is, and in which direction the chain
passes a joint, takes no part in that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st
from simulated import random_readings
from two_arms import ROBOT

from suta_calib.errors import SamplesError, UrdfError
from suta_calib.geometry.travel import TURNS
from suta_calib.measurements.sample_files import SampleColumns, read_samples
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ChainJoint, Mimic, read_chain
from suta_calib.model.kinematics import Segment
from suta_calib.model.parameters import (
    BACKLASH,
    BENDING,
    COMPLIANCE,
    DECAY,
    GAIN,
    GEAR_RATIO,
    HYSTERESIS,
    MASS,
    coupling_key,
)
from suta_calib.terms.poses import joint_ranges

# Numbers of a written URDF are rounded to 1e-12 m or rad; along a chain that adds up, and heavy
# links bend it by ten times as much.
WRITTEN = 4e-11

LINKS = 9
TYPES = ("revolute", "continuous", "prismatic", "fixed")


def tree(rng: np.random.Generator, mimics: bool) -> str:
    """A robot of random links, joints and masses; some joints follow an earlier one."""
    text, moving = ['<robot name="tree">'], list[str]()
    for k in range(LINKS):
        centre = " ".join(f"{x:.6g}" for x in rng.uniform(-0.2, 0.2, 3))
        text.append(
            f'<link name="l{k}"><inertial><origin xyz="{centre}"/><mass value="{1 + k}"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    for k in range(1, LINKS):
        kind = TYPES[rng.choice(4, p=[0.4, 0.2, 0.2, 0.2])]
        xyz, rpy, axis = (" ".join(f"{x:.6g}" for x in rng.uniform(-1, 1, 3)) for _ in range(3))
        parent = rng.integers(max(0, k - 3), k)
        mimic = ""
        if mimics and moving and kind != "fixed" and rng.random() < 0.5:
            mimic = f'<mimic joint="{rng.choice(moving)}" multiplier="-0.5" offset="0.2"/>'
        text.append(
            f'<joint name="j{k}" type="{kind}"><parent link="l{parent}"/><child link="l{k}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{mimic}'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
        moving += [f"j{k}"] if kind != "fixed" else []
    return "\n".join([*text, "</robot>"])


def _reading(arm: ArmModel, joint: ChainJoint, q: np.ndarray) -> float:
    """The joint's own, or what its mimic makes of another's."""
    m = joint.mimic or Mimic(joint.name, 1.0, 0.0)
    return m.multiplier * float(q[arm.joints.index(m.joint)]) + m.offset


class Reference:
    """The whole robot as Pinocchio has it, every joint off the chain at zero."""

    def __init__(self, text: str, arm: ArmModel) -> None:
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        self.arm = arm
        self.moving = [joint for joint in arm.chain.joints if joint.moving]

    def _configured(self, q: np.ndarray, more: Mapping[str, float]) -> np.ndarray:
        state = pin.neutral(self.model)
        for chained in self.moving:
            own = _reading(self.arm, chained, q) + more.get(chained.name, 0.0)
            joint = self.model.joints[self.model.getJointId(chained.name)]
            numbers = [own] if joint.nq == 1 else [math.cos(own), math.sin(own)]
            state[joint.idx_q : joint.idx_q + joint.nq] = numbers
        return state

    def pose(self, q: np.ndarray, more: Mapping[str, float]) -> pin.SE3:
        pin.framesForwardKinematics(self.model, self.data, self._configured(q, more))
        ends = (self.arm.chain.base, self.arm.chain.tip_link)
        base, tip = (self.data.oMf[self.model.getFrameId(n, pin.FrameType.BODY)] for n in ends)
        return base.actInv(tip)

    def torques(self, q: np.ndarray, coupled: Mapping[str, float]) -> dict[str, np.ndarray]:
        """What gravity does to each joint of the chain, turned by its readings and couplings.

        About the axes of the joint's frame, which stand on its parent link; held against
        Pinocchio's torques about the joints' own axes.
        """
        model, data, state = self.model, self.data, self._configured(q, coupled)
        own = pin.computeGeneralizedGravity(model, data, state)
        pin.rnea(model, data, state, np.zeros(model.nv), np.zeros(model.nv))
        found = {}
        for joint, segment in zip(self.moving, self.arm.movers, strict=True):
            k = model.getJointId(joint.name)
            motion = model.jointPlacements[k].actInv(data.liMi[k])
            found[joint.name] = -motion.act(data.f[k]).angular
            if joint.type != "prismatic":
                torque = found[joint.name] @ segment.axis
                np.testing.assert_allclose(torque, -own[model.joints[k].idx_v], atol=1e-9)
        return found

    def carry(self, payload: np.ndarray) -> None:
        """Let the tip carry a mass at a point of its frame."""
        tip = self.model.frames[self.model.getFrameId(self.arm.chain.tip_link, pin.FrameType.BODY)]
        # Pinocchio before 3 calls it otherwise.
        joint = tip.parentJoint if hasattr(tip, "parentJoint") else tip.parent
        self._add(joint, payload[0], tip.placement.act(payload[1:]))

    def weigh(self, beside: Mapping[str, float]) -> None:
        """Give what joints carry the masses of these values, about the same centres.

        What the chain's other links weigh, the joints off the chain carry along.
        """
        for load in self.arm.loads:
            more = beside[f"{load.joint}.{MASS}"] - load.mass
            self._add(self.model.getJointId(load.joint), more, load.centre)

    def _add(self, joint: int, mass: float, centre: np.ndarray) -> None:
        body = pin.Inertia(mass, centre, np.zeros((3, 3)))
        self.model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        self.data = self.model.createData()

    def bend(self, moves: Mapping[str, pin.SE3]) -> None:
        """Move joints' frames on their parent links."""
        for joint, move in moves.items():
            k = self.model.getJointId(joint)
            self.model.jointPlacements[k] = self.model.jointPlacements[k] * move


@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 10**6), mimics=st.booleans())
def test_random_trees_are_pinocchios(scratch: Path, seed: int, mimics: bool) -> None:
    rng = np.random.default_rng(seed)
    base, tip = (f"l{k}" for k in rng.choice(LINKS, 2, replace=False))
    path = scratch.with_suffix(".urdf")
    path.write_text(tree(rng, mimics))
    try:
        arm = ArmModel.from_urdf(path, tip, base)
    except UrdfError:
        reject()  # only fixed joints between the two
    values = {n: p.nominal + 0.1 * rng.standard_normal() for n, p in arm.parameters.items()}
    sizes = {MASS: (1.0, 2.0), DECAY: (0.5, 2.0)}
    # No play is as wide as a way is long: there it has no derivative.
    spreads = {GEAR_RATIO: 3.0, BACKLASH: rng.choice([1e-4, 0.5])}
    beside = {
        n: p.nominal * rng.uniform(*sizes[p.key])
        if p.key in sizes
        else spreads.get(p.key, 0.02) * rng.standard_normal()
        for n, p in arm.nongeometric.items()
    }
    q = random_readings(arm, rng, 3)
    signs = np.resize([1.0, -1.0], TURNS)
    travel = rng.uniform(-0.05, 0.05, (*q.shape, 1)) * signs / np.arange(1, TURNS + 1)
    payload = np.array([[0.0, 0, 0, 0], [2.0, 0.1, -0.2, 0.3], [5.0, 0.3, 0.1, -0.2]])
    # The URDF written back holds the geometry; the errors that no URDF holds move the joints.
    beside_readings = {"payload": payload, "travel": travel.reshape(len(q), -1)}
    poses = arm.forward(q, values | beside, beside_readings)
    for row, load, came, R, p in zip(q, payload, travel, *poses, strict=True):
        # Gravity pulls at the links as drawn, turned by readings, offsets and couplings.
        offsets = {n: v for n, v in values.items() if n in arm.offsets}
        nominal, told = (Reference(arm.calibrated_urdf(v), arm) for v in (offsets, values))
        nominal.weigh(beside)
        nominal.carry(load)
        torques = nominal.torques(row, _coupled(arm, row, beside))
        told.bend({s.owner: _bent(s, torques[s.owner], beside) for s in arm.movers})
        own = {s.owner: float(torques[s.owner] @ s.axis) for s in arm.movers}
        expected = told.pose(row, _turns(arm, row, came, beside, own))
        np.testing.assert_allclose(R, expected.rotation, rtol=0, atol=WRITTEN)
        np.testing.assert_allclose(p, expected.translation, rtol=0, atol=WRITTEN)
    names = [*values, *beside]
    theta = np.array([*values.values(), *beside.values()])
    function = arm.function(names, (*beside_readings,))
    row = q[1], *(numbers[1] for numbers in beside_readings.values())
    R, _, jacobian = (np.array(a) for a in function(theta, *row))
    # Of the fourth order: what heavy links bend by changes fast.
    size, weights = 2e-6, {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}
    for column, step in zip(jacobian, size * np.eye(len(names)), strict=True):
        moved = {s: [np.array(a) for a in function(theta + s * step, *row)] for s in weights}
        dR, dp = (
            np.sum([w * moved[s][k] for s, w in weights.items()], axis=0) / size for k in (0, 1)
        )
        np.testing.assert_allclose(column[:3], dp.ravel(), atol=3e-8)
        spin = dR.reshape(3, 3).T @ R.reshape(3, 3)
        np.testing.assert_allclose(column[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=3e-8)


def _bent(segment: Segment, torque: np.ndarray, beside: Mapping[str, float]) -> pin.SE3:
    """How a joint's frame moves on its parent link: about the axes across, by its compliances."""
    compliances = np.array([beside[n] for n in segment.names(*BENDING)])
    turn = segment.across @ (compliances * (segment.across.T @ torque))
    return pin.SE3(pin.exp3(turn), np.zeros(3))


def _turns(
    arm: ArmModel,
    q: np.ndarray,
    travel: np.ndarray,
    beside: Mapping[str, float],
    torques: Mapping[str, float],
) -> dict[str, float]:
    """By joint, how far errors that are no geometry move it, by their definition."""
    found = _coupled(arm, q, beside, more=True)
    for joint in arm.chain.joints:
        if joint.moving:
            own = _reading(arm, joint, q)
            phase = 2 * beside.get(f"{joint.name}.{GEAR_RATIO}", 0.0) * own
            waves = {
                "ripple_c": math.cos(phase),
                "ripple_s": math.sin(phase),
                GAIN: own,
                "ecc_c1": math.cos(own),
                "ecc_s1": math.sin(own),
                "ecc_c2": math.cos(2 * own),
                "ecc_s2": math.sin(2 * own),
                COMPLIANCE: torques[joint.name],
            }
            of = {key: beside.get(f"{joint.name}.{key}", 0.0) for key in waves}
            found[joint.name] += sum(of[key] * wave for key, wave in waves.items())
            found[joint.name] -= _lag(arm, joint, travel, beside)
    return found


def _lag(
    arm: ArmModel, joint: ChainJoint, travel: np.ndarray, beside: Mapping[str, float]
) -> float:
    """How far a joint lags behind its reading: by its play, and by its hysteresis."""
    mimic = joint.mimic or Mimic(joint.name, 1.0, 0.0)
    own = mimic.multiplier * travel[arm.joints.index(mimic.joint)]
    width, size, decay = (beside[f"{joint.name}.{key}"] for key in (BACKLASH, HYSTERESIS, DECAY))
    lag = 0.0
    for k, way in enumerate(own):
        # The first one began in the middle, and ends at half of it.
        share = 0.5 if k == 0 else 1.0
        play = math.copysign(_crossed(abs(way), share * abs(width)), width)
        rubbed = share * size * (1 - math.exp(-abs(way) / share / decay))
        lag += math.copysign(1.0, way) * (play + rubbed)
    return lag


def _crossed(way: float, limit: float) -> float:
    """How far a gap is crossed: the lesser of both, rounded over a tenth of the gap."""
    lesser, none = (0.5 * (x + limit - math.hypot(x - limit, 0.1 * limit)) for x in (way, 0.0))
    return (lesser - none) * limit / (limit - none)


def _coupled(
    arm: ArmModel, q: np.ndarray, beside: Mapping[str, float], more: bool = False
) -> dict[str, float]:
    """By joint, how far the readings of others move it; more of it than gravity knows."""
    readings = dict(zip(arm.joints, q.tolist(), strict=True))
    waves = {"cable_c": math.cos, "cable_s": math.sin}
    return {
        joint.name: sum(
            beside.get(f"{joint.name}.{coupling_key(other)}", 0.0) * reading
            for other, reading in readings.items()
        )
        + more
        * sum(
            beside.get(f"{joint.name}.{coupling_key(other, key)}", 0.0) * wave(reading)
            for other, reading in readings.items()
            for key, wave in waves.items()
        )
        for joint in arm.chain.joints
        if joint.moving
    }


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    path = tmp_path / "two_arms.urdf"
    path.write_text(ROBOT)
    return path


def test_one_arms_tip_is_the_base_of_the_other(robot: Path) -> None:
    arm = ArmModel.from_urdf(robot, "right", "left")
    assert (arm.chain.top, arm.joints) == ("column", ("left_2", "left_1", "right_1"))
    assert [joint.climbed for joint in arm.chain.joints] == [True] * 3 + [False] * 2
    owners = list(dict.fromkeys(arm.parameters[n].owner for n in arm.parameters))
    assert owners == ["left_flange", "left_2", "left_1", "right_1", "right"]
    # Both flanges are ends of the chain: geometric names them.
    assert {n.split(".")[0] for n in arm.geometric} == set(owners)
    # Backwards the same transform, inverted.
    back = ArmModel.from_urdf(robot, "left_flange", "right_flange")
    assert back.joints == arm.joints[::-1]
    q = np.array([0.3, -0.4, 0.5])
    (R, p), (Rb, pb) = arm.forward(q), back.forward(q[::-1])
    np.testing.assert_allclose(Rb, R.T, atol=1e-15)
    np.testing.assert_allclose(pb, -R.T @ p, atol=1e-15)


def test_a_chain_that_only_climbs(robot: Path) -> None:
    arm = ArmModel.from_urdf(robot, "floor", "left")
    assert (arm.chain.top, arm.joints) == ("floor", ("left_2", "left_1", "turn"))
    assert {n.split(".")[0] for n in arm.geometric} == {"left_flange", "left_2", "left_1", "turn"}


def test_the_values_of_both_branches_land_in_the_right_origins(robot: Path) -> None:
    arm = ArmModel.from_urdf(robot, "right", "left")
    values = {"left_2.x": 0.41, "left_flange.z": 0.02, "right.y": 0.01, "right_1.offset": 0.5}
    written = arm.calibrated_urdf(values).decode()
    pairs = zip(ROBOT.splitlines(), written.splitlines(), strict=True)
    changed = [new.strip().partition("/>")[0] for old, new in pairs if old != new]
    assert changed == [
        '<origin xyz="0.41 0 0"',
        '<origin xyz="0.3 0 0.02"',
        '<origin xyz="0 -0.2 1" rpy="0.0 0.5 0.0"',
        '<origin xyz="0.3 0.01 0"',
    ]


def test_a_follower_has_its_masters_column(robot: Path) -> None:
    """A mimic of a mimic follows the one at the end; the master need not be on the chain."""
    arm = ArmModel.from_urdf(robot, "f3", "right")
    assert arm.joints == ("finger_1",)
    assert arm.units == {"finger_1": "m"}
    assert [s.owner for s in arm.movers] == ["finger_2", "finger_3"]
    assert set(arm.read_from.values()) == {"finger_1"}
    np.testing.assert_allclose(arm.gearing, [[-4], [-2]])
    R, _ = arm.forward([0.02])
    turned = (-4 * 0.02 + 0.1) * 1.5
    np.testing.assert_allclose(R[0], [math.cos(turned), -math.sin(turned), 0], atol=1e-15)
    assert "finger_1.offset" not in arm.parameters
    assert "finger_3.offset" in arm.parameters


FOLLOWED = 'mimic joint="finger_1"'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (FOLLOWED, 'mimic joint="finger_0"', "'finger_0', which is not defined; expected a j"),
        (FOLLOWED, 'mimic joint="finger_3"', "a loop: 'finger_2' follows 'finger_3' follows 'fin"),
        (FOLLOWED, 'mimic joint="finger_2"', "found a loop: 'finger_2' follows 'finger_2'"),
        (FOLLOWED, 'mimic joint="left_flange"', "which is fixed and has no single reading; expec"),
        ('multiplier="-4"', 'multiplier="four"', "found multiplier='four'; expected a finite"),
        (FOLLOWED, "mimic", "found no joint"),
    ],
)
def test_mimics_that_follow_nobody_are_refused(
    robot: Path, old: str, new: str, message: str
) -> None:
    robot.write_text(ROBOT.replace(old, new))
    with pytest.raises(UrdfError, match=r":\d+: joint 'finger_[23]': <mimic>: ") as caught:
        read_chain(robot, "f3", "left")
    assert message in str(caught.value)


def test_a_link_may_be_called_as_a_joint_is(robot: Path) -> None:
    arm = ArmModel.from_urdf(robot, "right", "left")
    robot.write_text(ROBOT.replace('"l1"', '"left_1"').replace('"r1"', '"right_1"'))
    same = ArmModel.from_urdf(robot, "right", "left")
    assert same.joints == arm.joints
    q = np.array([0.3, -0.4, 0.5])
    for found, expected in zip(same.forward(q), arm.forward(q), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_missing_column_says_who_follows_it(robot: Path, tmp_path: Path) -> None:
    ranges = joint_ranges(ArmModel.from_urdf(robot, "f3", "left"))
    (tmp_path / "samples.csv").write_text("left_2,left_1,right_1,finger_2\n0,0,0,0\n")
    expected = r"finger_1.*in m \(or finger_1_mm\), which finger_2, finger_3 mimics"
    with pytest.raises(SamplesError, match=expected):
        read_samples([tmp_path / "samples.csv"], ranges, SampleColumns())
