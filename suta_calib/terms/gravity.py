"""Gravity, as an accelerometer or an inclinometer at rest on the tip's link feels it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final, Self

import casadi as ca
import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import Level
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import (
    nearest_rotation,
    rotation_from_vector,
    vector_from_rotation,
    vector_turning_z_to,
)
from suta_calib.geometry.symbols import Symbol, symbolic_rotation
from suta_calib.measurements import NumberColumn, SampleColumns
from suta_calib.measurements.felt import at_rest, unlike_gravity
from suta_calib.measurements.fields import (
    ANGLE,
    ANGLE_OR_0,
    DIRECTION,
    RPY_DEG,
    Field,
    keyed,
    mapping,
    quantity,
)
from suta_calib.model.parameters import ROTATION, Parameter
from suta_calib.terms.block import LEARNT, Block, Noise, Pose, flat, norm
from suta_calib.terms.external_frame import labelled
from suta_calib.terms.given_places import with_known
from suta_calib.terms.given_pose import GivenPose, PriorValue
from suta_calib.terms.observed import Observed
from suta_calib.terms.poses import ArmPoses, PoseSource
from suta_calib.terms.term import Gap, Term
from suta_calib.units import text

_ACCELERATION: Final = ("ax", "ay", "az")
_TILT: Final = ("roll", "pitch")
_BIAS: Final = ("bx", "by", "bz")
# A mount (3, 3) and a direction (3,), and how far what was measured is off them, rad.
_Weighed = tuple[tuple[FloatArray, FloatArray], float]


@dataclass(frozen=True, eq=False)
class SensorMount(Displayable):
    """How a sensor is turned in the tip's link, as far as that is known.

    Attributes:
        rotation: (3, 3) of the sensor in the frame of the tip.
        std: standard deviation of the turn about any axis, rad; None for an exact one.
    """

    rotation: FloatArray = keyed(
        RPY_DEG, "How it is turned, as in a URDF.", name="rotation_rpy_deg"
    )
    std: float | None = keyed(
        ANGLE,
        "Standard deviation of the turn about any axis; without it the orientation is exact.",
        None,
        "prior_deg",
    )


@dataclass(frozen=True, eq=False)
class UpDirection(Displayable):
    """Which direction is up in the base, as far as that is known.

    Attributes:
        direction: (3,) unit vector.
        std: standard deviation of the base's lean about either axis, rad; 0 for an exact one.
    """

    direction: FloatArray = keyed(
        DIRECTION, "Up, in the axes of the base; [0, 0, 1] for an arm that stands level."
    )
    std: float = keyed(
        ANGLE_OR_0, "Standard deviation of the base's lean about each axis.", 0.0, "prior_deg"
    )


def _off_direction(poses: Sequence[Pose], unknowns: Symbol, data: Symbol) -> Symbol:
    """The angle between what is felt and what was measured, as two components across the latter.

    Of length 2 sin(angle / 2): it grows up to 180°, where a sine would fall again. The data are a
    frame whose z axis is what was measured, and the sign of the base's axis that is nearly up.
    """
    measured, sign = ca.reshape(data[:9], 3, 3), data[9]
    up = symbolic_rotation(ca.vertcat(unknowns[0], unknowns[1], 0))[:, 2] * sign
    felt = symbolic_rotation(unknowns[2:5]).T @ poses[0].R.T @ up
    if unknowns.numel() > 5:
        felt = felt + unknowns[5:8]
    felt = measured.T @ felt / norm(felt)
    # Nothing but the opposite direction has a smaller number.
    return felt[:2] / ca.sqrt(ca.fmax((1.0 + felt[2]) / 2.0, 1e-12))


@dataclass(frozen=True, eq=False, repr=False)
class Gravity(Term):
    """The direction ``Sᵀ R_iᵀ u`` of "up" in a sensor at rest, against the one that it measured.

    R_i is the orientation of the tip in the base. How the sensor is mounted, S, and the direction u
    in the base, are unknown, or given. An accelerometer may have a zero error b on each axis, in
    parts of gravity: it measures ``Sᵀ R_iᵀ u + b``.

    It sees directions of axes and zeros of joints. No length shows in it, and no turn about the
    vertical.

    Attributes:
        poses: samples with the numbers ax, ay, az, in any one unit; or roll and pitch, rad, as of
            an inclinometer that was turned by ``Ry(pitch) Rx(roll)``.
        angular_noise: scatter and robustness of the direction, rad per component.
        label: sensors with the same label are mounted alike.
        sensor: how it is mounted, where that is known.
        up: which direction is up, where that is known.
        bias: standard deviation of an accelerometer's zero error on each axis, in parts of gravity;
            0 for one without.
        hangs: whether the z axis of the base is nearer to down than to up; None as the data say.

    Raises:
        SamplesError: the samples have neither accelerations nor angles.
    """

    kind = "gravity"
    order = 12
    about = (
        "an accelerometer or an inclinometer (a phone) on the tip's link, or on another link "
        "(link), felt gravity while the arm rested. It shows the zeros and the axes of the joints "
        "before it. It shows no length, and no turn about the vertical: not the zero of a first "
        "joint that turns about it. How the sensor is mounted, and whether the base is level, are "
        "estimated too, unless you state them"
    )
    columns = SampleColumns(
        numbers=(
            *(NumberColumn(name, required=False, noise_unit="rad") for name in _ACCELERATION),
            *(NumberColumn(name, "rad", required=False, offered=False) for name in _TILT),
        ),
        about={
            "ax": "Acceleration at rest along the sensor's x axis, in any one unit. It points up.",
            "ay": "The same along y.",
            "az": "The same along z.",
            "roll": "In place of these: turn of an inclinometer about its x axis.",
            "pitch": "The same about its y axis; its orientation is `Ry(pitch) Rx(roll)`.",
        },
    )
    sent = _ACCELERATION
    medium = "instrument"
    unit = "deg"
    keys = (
        Field(
            "sensor", mapping(SensorMount), "How the sensor is mounted on the tip's link, if known."
        ),
        Field("up", mapping(UpDirection), "Which direction is up in the base, if known."),
        Field(
            "bias",
            quantity(sign="non-negative"),
            "Standard deviation of the accelerometer's zero error on each axis, in parts of "
            "gravity (a phone: 0.02). The zero error is then estimated. Default: 0, no zero error.",
        ),
    )
    begun = (
        "How the sensor lies on its link, to how many degrees. Without it, the zero of the last",
        "joint before the sensor is not told.",
        "sensor: {rotation_rpy_deg: [0, 0, 0], prior_deg: 0.5}",
        "Which link it is on, if that is not the tip's. A sensor on the last link alone shows only",
        "the sum of the zeros of joints that turn about parallel axes: put it on the links between",
        "them too, each with a row and files of its own.",
        "link: LINK",
    )
    leaves_open: ClassVar[Mapping[Gap, tuple[str, str]]] = {
        "base": (
            "gravity shows no position, and no turn about the vertical",
            "nothing to do if the arm's base is only a convention; otherwise touch or see "
            "something that stands in the base",
        ),
        "tool": (
            "turns the tip in its link. Gravity does not show this, because the unknown mounting "
            "of the sensor cancels it",
            "state how the sensor is mounted (sensor), or touch something with the tip",
        ),
    }

    angular_noise: Noise = LEARNT
    label: str = "default"
    sensor: SensorMount | None = None
    up: UpDirection | None = None
    bias: float = 0.0
    hangs: bool | None = None

    @classmethod
    def measures_lengths(cls) -> bool:
        """Never."""
        return False

    @classmethod
    def refused_rest(cls, mean: FloatArray, std: FloatArray, earlier: FloatArray) -> str:
        """A sensor that was shaken, or that felt more or less than at the rests before."""
        length, scatter = (float(np.linalg.norm(vector)) for vector in (mean, std))
        usual = float(np.median(np.linalg.norm(earlier, axis=1))) if len(earlier) else length
        if usual and (why := unlike_gravity(length, usual)):
            return f"the accelerometer felt {length:.4g}, at the rests before {usual:.4g}. {why}"
        # Sensors for a few cents scatter by 1 % of gravity at 1000 readings per second.
        if scatter > 0.05 * length:
            return (
                f"the readings of the accelerometer scattered by {scatter:.3g}, of gravity "
                f"{length:.3g}: it was shaken. Let the arm and the sensor come to rest"
            )
        return ""

    @property
    def settings(self) -> Mapping[str, Any]:
        """What is given of the sensor and of the base."""
        return {"sensor": self.sensor, "up": self.up, "bias": self.bias}

    @property
    def opens(self) -> Mapping[Gap, tuple[str, str]]:
        """A sensor whose mounting is known leaves no turn of the tip open."""
        shut = {"tool"} if self.sensor is not None else set()
        return {gap: words for gap, words in self.leaves_open.items() if gap not in shut}

    @property
    def _owners(self) -> tuple[str, str]:
        """Of what is unknown of the base and of the sensor."""
        label = self.poses.label
        return labelled("up", label("default", "base")), labelled(
            "sensor", label(self.label, "tip")
        )

    @cached_property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """The lean of the base, the sensor's rotation vector, and its zero errors."""
        up, sensor = self._owners
        turns = ((up, "rx"), (up, "ry"), *((sensor, key) for key in ROTATION))
        biases = (
            Parameter(sensor, key, "1", plausible=self.bias, prior=self.bias)
            for key in (_BIAS if self.bias else ())
        )
        return (*(Parameter(owner, key, "rad", plausible=1.0) for owner, key in turns), *biases)

    @cached_property
    def unknowns(self) -> tuple[Parameter, ...]:
        """`own_parameters`, with what is given of them."""
        priors, (up, sensor) = dict[str, PriorValue](), self._owners
        if self.sensor is not None:
            pose = GivenPose(np.zeros(3), self.sensor.rotation, None, self.sensor.std)
            of_pose = pose.of_pose(sensor)
            priors |= {f"{sensor}.{key}": of_pose[f"{sensor}.{key}"] for key in ROTATION}
        if self.up is not None:
            lean, std = vector_turning_z_to(self._sign * self.up.direction), self.up.std or None
            priors |= {
                f"{up}.{key}": PriorValue(float(lean[k]), std) for k, key in enumerate(ROTATION[:2])
            }
        return with_known((*self.own_parameters, *self.of_clock), priors)

    @cached_property
    def _measured(self) -> tuple[FloatArray, FloatArray]:
        """What was measured: unit vectors (n, 3), and (n,) how long they were."""
        numbers = self.poses.samples.numbers
        if all(name in numbers for name in _ACCELERATION):
            vectors = np.column_stack([numbers[name] for name in _ACCELERATION])
        elif all(name in numbers for name in _TILT):
            vectors = _up_at(*(numbers[name] for name in _TILT))
        else:
            there = f"only {', '.join(numbers)}" if numbers else "no readings of a sensor"
            raise self.refuse(there, "columns ax, ay, az, or columns roll, pitch")
        length = np.linalg.norm(vectors, axis=1)
        unit = vectors / np.where(length > 0, length, 1.0)[:, None]
        unit[length == 0] = [0.0, 0.0, 1.0]
        return unit, length

    @cached_property
    def _sign(self) -> float:
        """1 where the base's z axis is nearer to up than -z is; -1 for an arm that hangs."""
        if self.hangs is not None:
            return -1.0 if self.hangs else 1.0
        if self.up is not None:
            return _side(self.up.direction)
        (stands, off), (free, off_free) = self._stands_or_free(self.poses.at({})[0])
        # Zeros and bases are off by some degrees; what turns with no base, by a radian and more.
        elsewhere = off > 0.3 and 3.0 * off_free < off
        return _side((free if elsewhere else stands)[1])

    def beside(self, terms: Sequence[Term]) -> Self:
        """Those that share a base agree on which way it stands: as the longest chain says."""
        same = [t for t in terms if isinstance(t, Gravity) and t._owners[0] == self._owners[0]]
        most = max(same, key=lambda t: (t.up is not None, t.poses.samples.q.shape[::-1]))
        return replace(self, hangs=most._sign < 0)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The direction."""
        measured, _ = self._measured
        frames = flat(rotation_from_vector(vector_turning_z_to(measured)))
        data = np.column_stack([frames, np.full(len(frames), self._sign)])
        columns = np.tile(np.arange(len(self.own_parameters)), (len(data), 1))
        labels, noise = self.poses.samples.origin, self.angular_noise
        return (
            Block.per_sample("direction", "rad", 2, _off_direction, columns, data, noise, labels),
        )

    def observed(self, values: Mapping[str, float], poses: PoseSource) -> Observed:
        """The readings of an ideal sensor, in the unit of the samples; in g where they are zero."""
        up, sensor = self._owners
        frame = rotation_from_vector([values[f"{up}.rx"], values[f"{up}.ry"], 0.0])
        mount = rotation_from_vector([values[f"{sensor}.{key}"] for key in ROTATION])
        felt = (poses.at(values)[0] @ mount).transpose(0, 2, 1) @ (self._sign * frame[:, 2])
        if self.bias:
            felt = felt + [values[f"{sensor}.{key}"] for key in _BIAS]
        if _ACCELERATION[0] in poses.samples.numbers:
            felt = felt * (float(np.median(self._measured[1])) or 1.0)
            return Observed(numbers=dict(zip(_ACCELERATION, felt.T, strict=True)))
        x, y, z = felt.T
        pitch = np.arctan2(-x, np.hypot(y, z))
        return Observed(numbers=dict(zip(_TILT, (np.arctan2(y, z), pitch), strict=True)))

    def start(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """By `_mount_and_up`; zero errors are nought."""
        del position
        mount, up = self._mount_and_up(rotation)
        lean = vector_turning_z_to(self._sign * up)[:2]
        biases = np.zeros(len(self.own_parameters) - 5)
        return np.concatenate([lean, vector_from_rotation(mount), biases])

    def _mount_and_up(self, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """S (3, 3) and u (3,) of ``R_i S a_i = u``."""
        (stands, off), (free, off_free) = self._stands_or_free(rotation)
        return free if off_free < off and _side(free[1]) == self._sign else stands

    def _stands_or_free(self, rotation: FloatArray) -> tuple[_Weighed, _Weighed]:
        """S and u of an arm that stands as its job says, and of any; how far each is off, rad.

        Of what is given, the other follows as a mean. If nothing is given, both are linear unknowns
        of one homogeneous system. It has more than one solution where few joints turn, and one that
        is a reflection where the axes of the sensor are left-handed.
        """
        measured, length = self._measured
        up = self._arms_up if self.up is None else self.up.direction
        mount = self._mount(rotation, up) if self.sensor is None else self.sensor.rotation
        stands = mount, up
        if not length.any():
            return (stands, 0.0), (stands, 0.0)
        if self.sensor is None and self.up is None:
            by_mount = np.einsum("nij,nk->nijk", rotation, measured).reshape(-1, 9)
            by_up = np.tile(np.eye(3), (len(measured), 1))
            by_columns = np.linalg.svd(np.hstack([by_mount, -by_up]))[2][-1][:9].reshape(3, 3)
            mount = nearest_rotation(by_columns * (np.sign(np.linalg.det(by_columns)) or 1.0))
        in_base = (rotation @ mount @ measured[:, :, None])[:, :, 0]
        mean = in_base.mean(axis=0)
        free = mount, (mean / np.linalg.norm(mean) if self.up is None and mean.any() else up)

        def off(mount: FloatArray, up: FloatArray) -> float:
            lean = (rotation @ mount @ measured[:, :, None])[:, :, 0] - up
            return float(np.sqrt(np.mean(np.sum(lean**2, axis=1))))

        return (stands, off(*stands)), (free, off(*free))

    def _mount(self, rotation: FloatArray, up: FloatArray) -> FloatArray:
        """S of ``S a_i = R_iᵀ u``, for a known u: Wahba's problem."""
        return nearest_rotation((rotation.transpose(0, 2, 1) @ up).T @ self._measured[0])

    @property
    def _arms_up(self) -> FloatArray:
        """(3,) up in the base, as the arm is said to stand."""
        if not isinstance(self.poses, ArmPoses):
            return np.array([0.0, 0.0, 1.0])
        down = self.poses.arm.gravity
        return np.asarray(-down / float(np.linalg.norm(down)))

    @property
    def misread(self) -> Iterator[tuple[str, Term]]:
        """With axes of the sensor the other way round; with roll and pitch exchanged."""
        numbers = self.poses.samples.numbers
        if _ACCELERATION[0] in numbers:
            for name in _ACCELERATION:
                what = f"{name} has the other sign, as where the sensor's axes are left-handed"
                yield what, self._with_numbers({name: -numbers[name]})
            turned = {name: -numbers[name] for name in _ACCELERATION}
            yield "the sensor shows which way is down: all signs change", self._with_numbers(turned)
            return
        roll, pitch = (numbers[name] for name in _TILT)
        yield "roll and pitch are exchanged", self._with_numbers({"roll": pitch, "pitch": roll})
        yield "pitch has the other sign", self._with_numbers({"pitch": -pitch})

    def _with_numbers(self, numbers: Mapping[str, FloatArray]) -> Term:
        samples = self.poses.samples
        again = replace(samples, numbers={**samples.numbers, **numbers})
        return self.over_poses(self.poses.with_samples(again))

    @property
    def notes(self) -> tuple[str, ...]:
        """By these readings the arm hangs, although the job says that it stands; or the reverse."""
        if self.up is not None or self._sign * self._arms_up[2] >= 0:
            return ()
        hangs = "hangs from its base" if self._sign < 0 else "stands on its base"
        return (
            f"by these directions the arm {hangs}. If it does not, the sensor reports gravity as "
            "pointing down, or its axes are left-handed: the values of the joints are right all "
            "the same, but those of the sensor and of up are not. If it does, state it "
            "(arm: {gravity: …})",
        )

    @property
    def doubts(self) -> Mapping[str, Level]:
        """Rows in which more, or less, than gravity was felt."""
        length = self._measured[1]
        ratio = length / float(np.median(length))
        moving = np.flatnonzero(~at_rest(self._measured[0] * length[:, None]))
        if not len(moving):
            return {}
        first = moving[0]
        sentence = (
            f"{len(moving)} of {len(ratio)} rows ({self.poses.samples.origin[first]} is the first) "
            f"felt other than gravity: {ratio[first]:.3g} times as much as most. The arm moved or "
            "shook. Let it rest, or leave these rows out."
        )
        return {sentence: "care"}

    def check_enough(self) -> None:
        """Three directions at least; all in one unit, none without any acceleration."""
        measured, length = self._measured
        if len(measured) < 3:
            raise self.refuse(f"{len(measured)} rows", "at least 3, in different postures")
        median, origin = float(np.median(length)), self.poses.samples.origin
        # From gravity in m/s² to one in g is a factor of ten; nothing at rest feels half as much.
        for row in np.flatnonzero((length < 0.5 * median) | (length > 2.0 * median)).tolist():
            raise self.refuse(
                f"an acceleration of {length[row]:.4g} in {origin[row]}, where most are "
                f"{median:.4g}",
                "gravity at rest, in one unit",
                "are g and m/s² mixed, or did the arm fall?",
            )
        if median == 0:
            raise self.refuse("accelerations of zero", "gravity at rest")
        spread = text(
            float(np.linalg.norm(measured - measured.mean(axis=0), axis=1).max()),
            "rad",
            with_unit=True,
        )
        if np.linalg.norm(np.ptp(measured, axis=0)) < 1e-3:
            raise self.refuse(
                f"directions that differ by no more than {spread}",
                "postures that turn the sensor against gravity",
            )


def _up_at(roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """(n, 3) "up" in an inclinometer that was turned by ``Ry(pitch) Rx(roll)``."""
    sine, cosine = np.sin(pitch), np.cos(pitch)
    return np.column_stack([-sine, cosine * np.sin(roll), cosine * np.cos(roll)])


def _side(up: FloatArray) -> float:
    """1 for a direction that is nearer to z than to -z; -1 for one that is not."""
    return 1.0 if up[2] >= 0 else -1.0
