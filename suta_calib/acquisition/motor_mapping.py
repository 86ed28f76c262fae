"""Which motor moves which joint, in which direction and from which zero, by touches of a sheet.

Every order of the motors and every combination of signs is a hypothesis (`motor_search`). What
touches alone cannot exclude, two facts do: joints stay within the limits of the URDF, and a flat
sheet is touched from its printed side. (A mirrored arm that touches it from below fits as well.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import numpy as np

from suta_calib.acquisition.motor_search import (
    OFFSET_STD,
    CrossTouches,
    MotorMapOptions,
    MotorOrder,
    OrderSearch,
)
from suta_calib.arrays import FloatArray
from suta_calib.assessment import Assessment, judged
from suta_calib.device.description import DeviceSpec, JointSpec, columns_of
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import wrap
from suta_calib.model.arm import ArmModel
from suta_calib.terms import Term
from suta_calib.units import deg, from_deg, mm
from suta_calib.words import enumerated, listed

DEFAULT: Final = MotorMapOptions()
Status = Literal["found", "ambiguous", "no_fit"]


class MappedJoint(NamedTuple):
    """A joint and the motor that moves it.

    Attributes:
        joint: its name in the URDF.
        motor: the name that its motor had in ``device.yaml``.
        spec: the joint as ``device.yaml`` should have it.
        turned: whether the direction differs from the one in ``device.yaml``.
        change: of the zero, rad of the joint.
        std: of the zero, rad; None where the touches do not determine it.
        counts: counts of one turn as the touches show them, and their standard deviation.
        lowest: angle in the touches, rad.
        highest: likewise.
    """

    joint: str
    motor: str
    spec: JointSpec
    turned: bool
    change: float
    std: float | None
    counts: tuple[float, float]
    lowest: float
    highest: float


@dataclass(frozen=True, eq=False)
class MotorMap(Displayable):
    """What touches say about motors and joints.

    Attributes:
        arm: at nominal.
        device: as it was described.
        touches: how many there are.
        best: the order that fits best.
        others: further ones that cannot be excluded, the best first.
        next_rms: of the best order that is excluded, m; inf where none was fitted.
        joints: of the best order.
        factor: how many times fewer counts a turn has than the device's description says.
        options: how they were found.
    """

    arm: ArmModel
    device: DeviceSpec
    touches: int
    best: MotorOrder
    others: tuple[MotorOrder, ...]
    next_rms: float
    joints: tuple[MappedJoint, ...]
    factor: float
    options: MotorMapOptions

    @property
    def status(self) -> Status:
        """Whether there is one mapping to use."""
        if not self.best.rms <= self.options.tolerance:
            return "no_fit"
        return "ambiguous" if self.others else "found"

    @property
    def exchanged(self) -> tuple[MappedJoint, ...]:
        """Joints that another motor moves than their name says."""
        return tuple(row for row in self.joints if row.motor != row.joint)

    @property
    def turned(self) -> tuple[MappedJoint, ...]:
        """Joints that count in the other direction."""
        return tuple(row for row in self.joints if row.turned)

    @property
    def corrected(self) -> DeviceSpec:
        """The device with every joint at its motor, in the order of the device."""
        named = {row.motor: row.spec for row in self.joints}
        specs = tuple(named.get(spec.name, spec) for spec in self.device.joints)
        counts = round(self.device.counts_per_turn / self.factor)
        return replace(self.device, joints=specs, counts_per_turn=counts)

    def reread(self, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Angles (k,) that the corrected device gives, by joint, rad.

        Args:
            readings: by name in ``device.yaml``, angles (k,) as it was described, rad.
        """
        before = {spec.name: spec for spec in self.device.joints}
        turns = dict(zip(self.device.names, self.device.turns, strict=True))
        angles = dict[str, FloatArray]()
        for row in self.joints:
            old, turn = before[row.motor], float(turns[row.motor])
            sent = readings[row.motor] * old.sign * turn / math.tau + old.zero
            angle = row.spec.sign * (sent - row.spec.zero) * math.tau / (turn / self.factor)
            angles[row.joint] = wrap(angle) if old.ratio == 1.0 else angle
        return angles

    @property
    @judged
    def assessment(self) -> Assessment:
        """Bad where no order fits, or several do."""
        status, best = self.status, self.best
        sentence = f"{self.touches} touches"
        if math.isfinite(best.rms):
            sentence += f", {mm(best.rms):.1f} mm from the crosses (RMS)"
        if math.isfinite(self.next_rms):
            sentence += f"; the next mapping is {mm(self.next_rms):.1f} mm away"
        if status == "no_fit":
            return Assessment.of(
                sentence,
                bad=[
                    "No order and no directions of the motors make the arm meet the crosses within "
                    "the limits of its joints. Check that the URDF is that of this arm, that every "
                    "touch has the name of its cross, and the places of the crosses in the "
                    "artefact's file."
                ],
            )
        bad = [self._ambiguity(other) for other in self.others[:3]]
        facts = [
            f"The motor called {row.motor} moves {row.joint}. The two were exchanged."
            for row in self.exchanged
        ]
        facts += [f"{row.joint} counts backwards: its sign is reversed." for row in self.turned]
        if not facts:
            facts.append("Motors and directions are as the device's file has them.")
        if self.factor != 1.0:
            counts = round(self.device.counts_per_turn / self.factor)
            facts.append(f"A turn has {counts} counts, not {self.device.counts_per_turn}.")
        if without_zero := [row.joint for row in self.joints if row.std is None]:
            facts.append(
                f"The zero of {listed(without_zero)} does not show in these touches: it is kept."
            )
        return Assessment.of(sentence, bad=bad, care=[*self._strange()], facts=facts)

    def _ambiguity(self, other: MotorOrder) -> str:
        """What two orders that both fit differ in, and what to measure."""
        names, best = self.arm.joints, self.best
        both = f"({mm(best.rms):.1f} and {mm(other.rms):.1f} mm)"
        moved = [names[k] for k in np.flatnonzero(other.motors != best.motors)]
        turned = [names[k] for k in np.flatnonzero(other.signs != best.signs)]
        if moved:
            return (
                f"Not decided: the motors of {enumerated(moved)} may be exchanged. Both orders "
                f"fit {both}. Touch more crosses, with these joints far from where they were."
            )
        hint = ",".join(f"{name}=1" for name in turned)
        # An arm that is mirrored as a whole has its zeros on the other side.
        far = float(np.abs(wrap(other.offsets - best.offsets)).max())
        remedy = "Touch more crosses, with the hand turned by 60 degrees or more"
        # Zeros so far apart are no matter of horns put on a tooth or two off, rad.
        if far > from_deg(60.0):
            remedy = (
                f"With the one, zeros are up to {deg(far):.0f} degrees from those of the other: "
                "the limits of the joints in the URDF would tell them apart. Add them"
            )
        return (
            f"Not decided: whether {enumerated(turned)} count{'s' * (len(turned) == 1)} "
            f"forwards or backwards. Both fit {both}. {remedy}, or state what you know: "
            f"--sign {hint}."
        )

    def _strange(self) -> Iterator[str]:
        """Counts of a turn that differ from what the device says."""
        for row in self.joints:
            stated, (counts, std) = row.spec.counts_per_turn, row.counts
            stated = stated or self.corrected.counts_per_turn
            # A wrong type of servo is far more off than any play makes it seem.
            if abs(counts - stated) > max(0.08 * stated, 5.0 * std):
                yield (
                    f"{row.joint} seems to have {counts:.0f} ± {std:.0f} counts per turn, not "
                    f"{stated}. Check the type of its servo, and its gear (ratio)."
                )


def map_motors(
    arm: ArmModel,
    terms: Sequence[Term],
    device: DeviceSpec,
    options: MotorMapOptions = DEFAULT,
) -> MotorMap:
    """The order and the signs of the motors under which touches meet the crosses.

    Args:
        arm: at nominal, whose joints all turn.
        terms: touched landmarks, over readings as the device's description gives them.
        device: that sent the readings.
        options: what is known, and how to search.

    Raises:
        InputError: joints that slide or are too many, no touches, or too few of them.
    """
    _check_arm(arm, options)
    touches = CrossTouches.of(arm, terms)
    search = OrderSearch(arm, touches, options)
    answer, factor = search.orders(1.0), 1.0
    if not (answer and answer[0].rms <= options.tolerance):
        # Of encoders that such servos have, 2^10 to 2^16 counts a turn, in place of one another.
        for other in (4.0, 0.25, 2.0, 0.5, 16.0, 1 / 16):
            tried = search.orders(other)
            if tried and tried[0].rms <= options.tolerance:
                answer, factor = tried, other
                break
    if not answer:
        raise InputError(
            "readings that no motor could give within the limits of the URDF",
            "limits of the joints as this arm has them",
            file=arm.chain.path,
        )
    best = answer[0]
    # Noise is at least what is assumed of an arm that nobody has calibrated.
    noise = max(1.0, best.cost / search.redundancy)
    # An order that costs so much more than the best is excluded. Of the 3840 of five joints one in
    # a hundred arms would then lose the right one by chance: 3840 · exp(-25 / 2) = 0.014.
    open_orders = [o for o in answer[1:] if o.cost - best.cost < 25.0 * noise]
    beyond = (o.rms for o in answer[1:] if o not in open_orders)
    return MotorMap(
        *(arm, device, len(touches.readings), best, tuple(open_orders), next(beyond, math.inf)),
        tuple(_joints(arm, device, search, best, factor)),
        *(factor, options),
    )


def _check_arm(arm: ArmModel, options: MotorMapOptions) -> None:
    path = arm.chain.path
    if sliding := [joint.name for joint in arm.readings if joint.type == "prismatic"]:
        raise InputError(f"{listed(sliding)}, which slides", "joints that turn", file=path)
    # Of 8 joints, with exchanged pairs alone, there are 7,424 hypotheses; of more, too many.
    most_joints = 8
    if len(arm.joints) > most_joints:
        expected = f"at most {most_joints}: of more there are too many orders"
        raise InputError(f"{len(arm.joints)} joints", expected, file=path)
    for name in options.signs:
        if name not in arm.joints:
            raise InputError(name, f"one of {', '.join(arm.joints)}", where="--sign")


def _joints(
    arm: ArmModel, device: DeviceSpec, search: OrderSearch, best: MotorOrder, factor: float
) -> Iterator[MappedJoint]:
    """Each joint with its motor, as the device's file should have them."""
    specs = [device.joints[k] for k in columns_of(arm.joints, device.names, "the arm", device.path)]
    stds, gains, gain_stds = search.uncertainty(best, factor)
    angles = best.read(factor * search.touches.readings)
    for k, joint in enumerate(arm.joints):
        spec, sign = specs[best.motors[k]], int(best.signs[k])
        turn = device.turns[device.names.index(spec.name)] / factor
        # The prior alone holds an offset that the touches do not show.
        has_zero = bool(stds[k] < 0.5 * OFFSET_STD)
        offset = float(best.offsets[k]) if has_zero else 0.0
        signed = sign * spec.sign
        zero = spec.zero - signed * offset * turn / math.tau
        if device.unit == "counts":
            zero = float(round(zero % abs(turn)) if spec.ratio == 1.0 else round(zero))
        counts = None if spec.counts_per_turn is None else round(spec.counts_per_turn / factor)
        stated = (spec.counts_per_turn or device.counts_per_turn) / factor
        yield MappedJoint(
            joint=joint,
            motor=spec.name,
            spec=replace(spec, name=joint, sign=signed, zero=zero, counts_per_turn=counts),
            turned=sign < 0,
            change=offset,
            std=float(stds[k]) if has_zero else None,
            counts=(float(stated / (1 + gains[k])), float(stated * gain_stds[k])),
            lowest=float(angles[:, k].min()),
            highest=float(angles[:, k].max()),
        )
