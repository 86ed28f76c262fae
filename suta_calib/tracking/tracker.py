"""From a reading to the pose of the tip: the arm, its tool, and how sure that is.

Compiled, it takes some ten microseconds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import casadi as ca
import numpy as np
import pinocchio as pin

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.assessment import refuse_unusable
from suta_calib.batched import Batched
from suta_calib.device.description import columns_of
from suta_calib.device.reading import Reading
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.geometry.symbols import symbolic_skew
from suta_calib.geometry.travel import FLICKER, TURNS, JointMemory
from suta_calib.model.arm import ArmModel
from suta_calib.model.cell import own_names
from suta_calib.model.kinematics import Condition
from suta_calib.model.parameters import BACKLASH, HYSTERESIS, ParameterSet
from suta_calib.model.robot import AnyArm
from suta_calib.tracking.uncertainty import CalibrationUncertainty, numbers, read_json_object
from suta_calib.units import from_mm, text
from suta_calib.words import listed

# Keys of what a joint lags behind by, as it came.
_LAGS: Final = (BACKLASH, HYSTERESIS)


@dataclass(frozen=True, eq=False, slots=True)
class TrackedPose(Displayable):
    """``T_base_tip`` of one reading; with a tool, the position is that of the tool's tip.

    Attributes:
        sequence: the reading's number, unwrapped: gaps are frames that were lost.
        time: s, of the device's clock.
        arrival: s, `time.perf_counter` when the frame's last byte was read.
        host_time: s since 1970, UTC, of the same moment.
        angles: (joints,) readings in the order of the arm's joints, rad.
        rotation: (3, 3), NaN where the pose is not valid.
        position: (3,) m, likewise.
        quaternion: (4,) x y z w with w ≥ 0, likewise.
        std: (3,) standard uncertainty of the position along the base's axes, m; None where no
            calibration's covariance is known.
        turn_std: (3,) standard uncertainty of the orientation, of small turns about the base's
            axes, rad; None likewise.
        errors: joints whose encoder says that its position is invalid: there is no pose then.
        warnings: joints whose encoder warns; their pose is valid.
        shift: (3,) what a re-calibration would add to the position, m; None without one.
        shift_std: (3,) standard uncertainty of the position with it, m; None likewise.
        temperature: of the arm, °C, where the device sends one.
    """

    sequence: int
    time: float
    arrival: float
    host_time: float
    angles: FloatArray
    rotation: FloatArray
    position: FloatArray
    quaternion: FloatArray
    std: FloatArray | None
    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    turn_std: FloatArray | None = None
    shift: FloatArray | None = None
    shift_std: FloatArray | None = None
    temperature: float | None = None

    @property
    def valid(self) -> bool:
        """Whether every encoder of the arm vouches for its position."""
        return not self.errors


@dataclass(frozen=True, eq=False)
class Tool(Displayable):
    """Where a tool's tip is.

    Attributes:
        tip: (3,) in the arm's tip frame, m.
        std: (3,) its standard uncertainty along that frame's axes, m; None where not known.
    """

    tip: FloatArray
    std: FloatArray | None = None


# The tip is the arm's own.
NO_TOOL: Final = Tool(np.zeros(3))


def read_tool(path: str | Path, *, anyway: bool = False) -> Tool:
    """Read ``tip.json``: ``{"tip_mm": [x, y, z], "tip_std_mm": [...]}``, the latter optional.

    Args:
        path: the file, or a pivot's ``result.json``, which has these keys too.
        anyway: take an answer that says of itself that it must not be used.

    Raises:
        InputError: unreadable, no ``tip_mm``, not three finite numbers within 10 m, or not to be
            used.
    """
    # m; a pivot offset beyond this is one in another unit.
    largest = 10.0
    path = Path(path)
    data = read_json_object(path)
    if "tip_mm" not in data:
        raise InputError(
            f"only the keys {', '.join(data) or '(none)'}",
            '"tip_mm": [x, y, z], as suta-calib pivot --out writes it',
            file=path,
            where="tip_mm",
        )
    refuse_unusable(data, path, anyway=anyway)
    tip = from_mm(numbers(data["tip_mm"], (3,), path, "tip_mm"))
    if abs(tip).max() > largest:
        raise InputError(
            repr(data["tip_mm"]), f"mm, within {largest:g} m", file=path, where="tip_mm"
        )
    std = data.get("tip_std_mm")
    return Tool(tip, None if std is None else from_mm(numbers(std, (3,), path, "tip_std_mm")))


class TipKinematics:
    """``T_base_tip`` of a calibrated arm with a tool, and how far it may be off.

    The variance of the tip's position is ``J C Jᵀ + R C_tool Rᵀ``, with J the tip's Jacobian by the
    arm's parameters at this very posture, C the calibration's covariance and C_tool the tool's.
    Of parameters that the calibration held it says what the uncertainty was given
    (`CalibrationUncertainty.with_held`), and nothing of the encoders' noise.

    Args:
        arm: the calibrated arm, for raw readings.
        tool: where the tool's tip is; the arm's own tip by default.
        uncertainty: of the calibration that wrote the arm's URDF; what that could not hold
            (eccentric encoders, yielding joints) is corrected from it. Joints that lag by where
            they came from are followed from the first reading on, one call after the other.
        payload: (4,) what the tip carries: a mass, kg, and its centre in the frame of the tip, m;
            nothing by default. It moves the tip of an arm that yields.

    Raises:
        InputError: the uncertainty is not this arm's.
    """

    def __init__(
        self,
        arm: ArmModel,
        tool: Tool = NO_TOOL,
        uncertainty: CalibrationUncertainty | None = None,
        payload: FloatArray | None = None,
    ) -> None:
        self._known = uncertainty is not None
        self._run = Batched(_compiled(arm, tool, uncertainty, payload), 1)
        # Of an arm whose joints remember: where each has come from since the first reading.
        remembers = len(self._run.inputs) > 1
        self._memories = [JointMemory(0.5 * FLICKER) for _ in arm.joints] if remembers else []

    def __call__(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Rotation (3, 3), position (3,) m and its standard uncertainty (3,) m along base axes."""
        return self.with_turns(angles)[:3]

    def with_turns(
        self, angles: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray | None]:
        """As a call, and the standard uncertainty of turns about the base's axes (3,), rad.

        A tool's own uncertainty is of its tip's position: it turns nothing.
        """
        run = self._run
        run.inputs[0][0] = angles
        if self._memories:
            ways = [m.after(float(q)) for m, q in zip(self._memories, angles, strict=True)]
            run.inputs[1][0] = np.concatenate([w + [0.0] * (TURNS - len(w)) for w in ways])
        flat, position, std, turn_std = run()
        rotation = flat.reshape(3, 3).T.copy()
        stds = (std[0].copy(), turn_std[0].copy()) if self._known else (None, None)
        return rotation, position[0].copy(), *stds


def quaternion(rotation: FloatArray) -> FloatArray:
    """Quaternion x y z w (4,) of a rotation matrix (3, 3), w ≥ 0."""
    xyzw = np.asarray(pin.Quaternion(rotation).coeffs(), dtype=float)
    return -xyzw if xyzw[3] < 0 else xyzw


def _compiled(
    arm: ArmModel,
    tool: Tool,
    uncertainty: CalibrationUncertainty | None,
    payload: FloatArray | None,
) -> Any:
    """CasADi function: readings → rotation (9, column by column), position, std, turn_std (3)."""
    names, factor = ((), np.zeros((0, 0))) if uncertainty is None else uncertainty.folded(arm)
    beside = {} if uncertainty is None else uncertainty.beside_geometry
    nominal = ca.DM([beside.get(name, arm.offered[name].nominal) for name in names])
    q = ca.SX.sym("q", len(arm.joints))
    remembered = any(arm.offered[name].key in _LAGS for name in beside)
    inputs = [q, *([ca.SX.sym("travel", TURNS * q.numel())] if remembered else [])]
    conditions: list[Condition] = ["travel"] if remembered else []
    loaded = [] if payload is None else [ca.DM(payload)]
    conditions += ["payload"] if loaded else []
    function = arm.function(names, conditions)
    flat, tip, jacobian = function(nominal, *inputs, *loaded)
    R = ca.reshape(flat, 3, 3)
    lever = R @ ca.DM(tool.tip)
    by_error = (jacobian[:, :3].T - symbolic_skew(lever) @ jacobian[:, 3:].T) @ ca.DM(factor)
    by_tool = R @ ca.diag(ca.DM(np.zeros(3) if tool.std is None else tool.std))
    std = ca.sqrt(ca.sum2(ca.horzcat(by_error, by_tool) ** 2))
    turn_std = ca.sqrt(ca.sum2((jacobian[:, 3:].T @ ca.DM(factor)) ** 2))
    outputs = [ca.densify(o) for o in (flat, tip + lever, std, turn_std)]
    named = ["rotation", "position", "std", "turn_std"]
    return ca.Function("tip", inputs, outputs, ["q", "travel"][: len(inputs)], named, {"cse": True})


def followed(parameters: ParameterSet, values: Mapping[str, float]) -> str:
    """That joints are followed to know where they come from; empty where none lags."""
    lags = [n for n, v in values.items() if n in parameters and parameters[n].key in _LAGS and v]
    if not lags:
        return ""
    joints = listed(tuple(dict.fromkeys(parameters[name].owner for name in lags)))
    sizes = listed(
        [
            f"{name} {text(abs(values[name]), parameters[name].unit, with_unit=True)}"
            for name in lags
        ]
    )
    return (
        f"{joints}: the joint lags behind its reading by where it came from ({sizes}). This is "
        "followed from the first reading on. Until a joint has turned back once, its angle may be "
        "wrong by half of the value: move every joint to and fro first."
    )


Correction: TypeAlias = Callable[[FloatArray, float | None], tuple[FloatArray, FloatArray]]
_NO_POSE: Final = (np.full((3, 3), np.nan), np.full(3, np.nan), None, None)


class Tracker:
    """Turns every reading into a pose.

    Joints are matched by name: the device may have more joints than the chain, in any order. A
    reading in which an encoder of the chain raises its error flag gives a pose that is not valid
    and carries no numbers.

    Args:
        arm: the calibrated arm.
        device_joints: names in the order of the readings' angles.
        kinematics: of the same arm.
        device: the device's file, for messages.
        correction: of a re-calibration: from angles and temperature what it would add to the
            position (3,), m, and the standard uncertainty of the sum (3,), m.
        warmth: place of the temperature in what the device sends beside the joints.

    Raises:
        InputError: the device lacks a joint of the chain.
    """

    def __init__(
        self,
        arm: ArmModel,
        device_joints: Sequence[str],
        kinematics: TipKinematics,
        device: Path | None = None,
        correction: Correction | None = None,
        warmth: int | None = None,
    ) -> None:
        self.kinematics = kinematics
        self._correction, self._warmth = correction, warmth
        self._columns = matched_joints(arm, device_joints, device)
        self._named = list(zip(arm.joints, self._columns.tolist(), strict=True))
        self._since_1970 = time.time() - time.perf_counter()

    def pose(self, reading: Reading) -> TrackedPose:
        """The tip's pose at this reading."""
        angles = reading.angles[self._columns]
        errors, warnings = (
            tuple(name for name, column in self._named if flags[column]) if flags.any() else ()
            for flags in (reading.error, reading.warning)
        )
        rotation, position, std, turn_std = (
            _NO_POSE if errors else self.kinematics.with_turns(angles)
        )
        turn = np.full(4, np.nan) if errors else quaternion(rotation)
        temperature = None if self._warmth is None else float(reading.extra[self._warmth])
        shift, shift_std = (
            (None, None)
            if self._correction is None or errors
            else self._correction(angles, temperature)
        )
        return TrackedPose(
            reading.sequence,
            reading.time,
            reading.arrival,
            reading.arrival + self._since_1970,
            angles,
            rotation,
            position,
            turn,
            std,
            errors,
            warnings,
            turn_std,
            shift,
            shift_std,
            temperature,
        )


def matched_joints(
    arm: AnyArm, device_joints: Sequence[str], device: Path | None = None
) -> IntArray:
    """(n,) for each joint of the chain, or of all chains, its place among the device's.

    Raises:
        InputError: the device lacks one; names it and what the device has.
    """
    chain = " and ".join(f"{chain.base} → {chain.tip}" for chain in arm.chained)
    short = own_names(arm.joints)
    # The device of one robot of a cell calls its joints as that robot's URDF does.
    alone = short and {*short.values()} <= {*device_joints} and not {*short} & {*device_joints}
    joints = [short.get(name, name) for name in arm.joints] if alone else arm.joints
    return columns_of(joints, device_joints, f"the chain {chain}", device)
