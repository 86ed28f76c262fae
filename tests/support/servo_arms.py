"""Arms of hobby servos: 4096 ticks a turn, play that gravity takes up, motors in any order.

A joint that the hand's weight loads lies on one side of its play. The others lie anywhere within
the part of it that whoever moves the arm leaves: pushed lightly to one side, a quarter. Horns were
put on by hand, lengths and axes are those of printed parts, and nobody measured where the tip is
in the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from suta_calib import ArmModel
from suta_calib.arrays import FloatArray, IntArray
from suta_calib.device.description import DeviceSpec, JointSpec
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.job.pen import PEN, with_pen
from suta_calib.measurements.artefact import Artefact
from suta_calib.model.parameters import OFFSET, POSITION
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.units import from_deg

URDF = Path(__file__).parents[2] / "examples/so101_printed_sheet/arm.urdf"
TICKS = 4096
# Places of the sheet: position, mm, and roll, pitch, yaw, deg; as on a table, and on a slope.
TABLE = ((170.0, 0.0, 0.0), (0.0, 0.0, 0.0))
SLOPE = ((180.0, 10.0, 50.0), (5.0, -15.0, -10.0))


@dataclass(eq=False)
class ServoArm:
    """A simulated arm on a bus of servos.

    Attributes:
        arm: at nominal.
        truth: by name, parameters that differ from it; without offsets.
        zero: (n,) rad, joint angle where each motor's reading is 0.
        order: (n,) for each joint, the number of its motor on the bus, from 0.
        signs: (n,) 1 or -1, of each joint.
        play: total play of a servo, rad.
        left: share of it that is left where gravity does not take it up.
        random: of everything.
    """

    arm: ArmModel
    truth: dict[str, float]
    zero: FloatArray
    order: IntArray
    signs: IntArray
    play: float
    left: float
    random: np.random.Generator
    device: DeviceSpec = field(init=False)

    def __post_init__(self) -> None:
        joints = tuple(
            JointSpec(joint, zero=TICKS // 2, number=k + 1)
            for k, joint in enumerate(self.arm.joints)
        )
        path = Path("device.yaml")
        self.device = DeviceSpec(path, "/dev/ttyACM0", 10**6, "feetech", "counts", TICKS, joints)

    @classmethod
    def made(
        cls,
        arm: ArmModel,
        seed: int,
        *,
        zero_deg: float = 10.0,
        play_deg: float = 1.5,
        left: float = 0.25,
        order: Sequence[int] | None = None,
        signs: Sequence[int] | None = None,
        pen: Sequence[float] = (0.04, -0.005, 0.1),
    ) -> ServoArm:
        """An arm of a seed: ``zero_deg`` is the standard deviation of the horns' places."""
        random = np.random.default_rng([41, seed])
        truth = dict[str, float]()
        for name, p in arm.parameters.items():
            if p.key == OFFSET or name in arm.like_offsets or name not in arm.geometric:
                continue
            if p.owner == arm.tip:
                if p.key in POSITION:
                    truth[name] = p.nominal + pen["xyz".index(p.key)]
            elif p.key in POSITION:
                truth[name] = p.nominal + 1e-3 * random.standard_normal()
            else:
                truth[name] = from_deg(0.4) * random.standard_normal()
        n = len(arm.joints)
        return cls(
            *(arm, truth, from_deg(zero_deg) * random.standard_normal(n)),
            np.arange(n) if order is None else np.array(order),
            np.ones(n, dtype=int) if signs is None else np.array(signs),
            *(from_deg(play_deg), left, random),
        )

    def ticks(self, q: FloatArray) -> IntArray:
        """Present_Position (k, motors) at true angles (k, n)."""
        angles = self.read_at(q, self.random.uniform(-0.5, 0.5, q.shape)) * self.signs
        ticks = np.rint(angles * TICKS / (2 * np.pi)).astype(int) + TICKS // 2
        sent = np.empty_like(ticks)
        sent[:, self.order] = ticks
        return sent

    def read_at(self, q: FloatArray, slack: FloatArray | float = 0.0) -> FloatArray:
        """Angles (k, n) of the joints as servos read them at true angles, rad.

        Args:
            q: true angles.
            slack: where within its play a joint is that gravity does not hold, from -0.5 to 0.5.
        """
        side = self.hanging(q)
        within = np.where(side != 0, -0.5 * side + 0.04 * slack, self.left * slack)
        return np.asarray(q - self.zero + self.play * within)

    def hanging(self, q: FloatArray) -> FloatArray:
        """On which side of its play each joint hangs: -1 or 1, 0 if gravity does not hold it."""
        rise = np.array([self._rise(joint, q) for joint in range(q.shape[1])]).T
        # Where a turn lifts the tip by less than 20 mm per rad, friction decides.
        return np.asarray(np.sign(rise) * (np.abs(rise) > 0.02))

    def _rise(self, joint: int, q: FloatArray) -> FloatArray:
        """By how much a point on the axis of the last joint rises with an angle, m/rad."""
        step = 1e-4
        moved = q.copy()
        moved[:, joint] += step
        return np.asarray((self._hand(moved) - self._hand(q)) / step)

    def _hand(self, q: FloatArray) -> FloatArray:
        """How high the hand is, m: where the URDF's last frame begins."""
        rotation, position = self.at(q)
        tip = np.array([self.truth[f"{self.arm.tip}.{axis}"] for axis in "xyz"])
        return np.asarray((position - rotation @ tip)[:, 2])

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """True poses of the tip."""
        return self.arm.forward(q, self.truth)

    def readings(self, q: FloatArray) -> FloatArray:
        """Angles (k, n) as `device` gives them for its joints, rad."""
        return np.asarray((self.ticks(q) - TICKS // 2) * (2 * np.pi / TICKS), dtype=float)

    def touching(
        self, crosses: FloatArray, posture_deg: Sequence[float], turn_deg: float = 60.0
    ) -> FloatArray:
        """True angles (k, n) that bring the tip to places (k, 3), the hand tilted and turned."""
        lower = np.array([joint.lower for joint in self.arm.readings])
        upper = np.array([joint.upper for joint in self.arm.readings])
        found, missing = np.zeros((len(crosses), len(lower))), np.arange(len(crosses))
        kinematics = InverseKinematics(self.arm, self.truth)
        spread = np.radians([25.0] * (len(lower) - 1) + [turn_deg])
        for tries in range(40):
            starts = np.radians(posture_deg) + spread * self.random.uniform(
                -1, 1, (len(missing), len(lower))
            )
            targets = Targets(
                crosses[missing], np.tile(np.eye(3), (len(missing), 1, 1)), "position"
            )
            answer = kinematics.solve(targets, starts, self.random, starts=1)
            inside = ((answer.q > lower + 0.1) & (answer.q < upper - 0.1)).all(axis=1)
            hand = self._hand(answer.q) - self.at(answer.q)[1][:, 2]
            # The hand leans to one side, so that its weight always takes up the same play,
            # where that is possible.
            leaning = (self.hanging(answer.q)[:, 1:-1] == self._leaning(posture_deg)).all(axis=1)
            good = answer.reached & inside & (hand > 0.03) & (leaning | (tries > 25))
            found[missing[good]] = answer.q[good]
            missing = missing[~good]
            if not len(missing):
                return found
        raise AssertionError(f"{len(missing)} places out of reach")

    def _leaning(self, posture_deg: Sequence[float]) -> FloatArray:
        return self.hanging(np.radians([posture_deg]))[:, 1:-1]


def arm_with_pen(folder: Path | None = None) -> ArmModel:
    """The five-joint arm of the examples with a pen in its hand, as ``init --pen`` writes it."""
    text = with_pen(URDF, "hand", URDF.parent, URDF.parent)
    if folder is None:
        return ArmModel.from_urdf(text, PEN)
    (folder / "arm.urdf").write_text(text)
    return ArmModel.from_urdf(folder / "arm.urdf", PEN)


def placed(artefact: Artefact, place: tuple[Sequence[float], Sequence[float]]) -> FloatArray:
    """Where all landmarks of an artefact are that stands somewhere, (k, 3), m."""
    position, rpy = place
    at = np.array([mark.position for mark in artefact.landmarks.values()])
    return at @ rotation_from_rpy(np.radians(rpy)).T + np.array(position) / 1e3
