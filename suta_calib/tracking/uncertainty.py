"""What a calibration knows of its own errors, for the arm it wrote.

``result.json`` speaks of the nominal URDF's parameters; the arm that is tracked is the calibrated
URDF, whose joints have swallowed offsets and turns. Both describe the same arm, so a small error
of the one is a small error of the other: `CalibrationUncertainty.folded` gives the matrix between.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.assessment import refuse_unusable
from suta_calib.atomic import recover
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import (
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
    vector_from_rotation,
)
from suta_calib.measurements.files import read_text
from suta_calib.model.arm import ArmModel
from suta_calib.model.chain import ChainJoint
from suta_calib.model.kinematics import Segment
from suta_calib.model.parameters import OFFSET, PLACEMENT, POSITION
from suta_calib.model.robot import AnyArm, placed_joints
from suta_calib.model.tilt import is_share
from suta_calib.model.urdf import folded_origin
from suta_calib.simulation.inverse_kinematics import InverseKinematics
from suta_calib.trust.tip import sensitivity
from suta_calib.units import FARTHEST

Source = Literal["covariance", "correlations", "std"]
# How the figures were told, for people.
SOURCE_WORDS: Final[dict[Source, str]] = {
    "covariance": "covariance of the calibration",
    "correlations": "standard deviations and rounded correlations of the calibration",
    "std": "standard deviations of the calibration only, without correlations",
}


@dataclass(frozen=True, eq=False)
class CalibrationUncertainty(Displayable):
    """Covariance of the arm's parameters as a calibration estimated them.

    Attributes:
        path: the ``result.json``.
        names: (n,) estimated parameters, in the covariance's order.
        covariance: (n, n), m and rad.
        values: value of every parameter of the arm that the file names, gains, eccentricities
            and compliances among them: the calibrated URDF lacks these.
        source: what the file offered.
        fixed: parameters the data could not tell: what is said holds relative to them.
        beside_geometry: gains, eccentricities and compliances that are not zero, and masses that
            are not those of the URDF: no URDF holds them.
        held: of the fixed ones, how each parameter changes with it, and how far off it may be, m
            and rad; empty where the file does not say.
        counted: of those that were fixed, the ones whose doubt stands in the covariance
            (`with_held`).
    """

    path: Path
    names: tuple[str, ...]
    covariance: FloatArray
    values: dict[str, float]
    source: Source
    fixed: tuple[str, ...]
    beside_geometry: dict[str, float]
    held: tuple[tuple[str, Mapping[str, float], float], ...] = ()
    counted: tuple[str, ...] = ()

    def with_held(self, arm: ArmModel) -> CalibrationUncertainty:
        """The same, with the doubt about what was held and the tip hangs on.

        A parameter that may be anywhere within ± what is plausible has 1/√3 of that as its standard
        uncertainty (GUM 4.3.7), and takes what goes with it along. What only draws frames
        elsewhere, such as where the arm's base is, stays a convention.

        Args:
            arm: the calibrated arm.

        Raises:
            InputError: the arm is not the one that was calibrated.
        """
        if not self.held:
            return self
        random = np.random.default_rng(0)
        # All over the arm's range, to see whether the tip hangs on a parameter.
        anywhere = InverseKinematics(arm, {}).random_readings(random, 96)
        counted, names, spreads = list[str](), list(self.names), list[Mapping[str, float]]()
        for fixed, direction, plausible in self.held:
            step = {name: factor * plausible for name, factor in direction.items()}
            alone = replace(self, names=tuple(step), covariance=_square(step, tuple(step)))
            moving, factor = alone.folded(arm)
            at = sensitivity(arm, self.beside_geometry, moving, anywhere)
            if at.moved(factor[:, -1]):
                counted.append(fixed)
                names += [name for name in step if name not in names]
                spreads.append({name: change / math.sqrt(3.0) for name, change in step.items()})
        covariance = np.zeros((len(names),) * 2)
        covariance[: len(self.names), : len(self.names)] = self.covariance
        for spread in spreads:
            covariance += _square(spread, names)
        return replace(
            self,
            names=tuple(names),
            covariance=covariance,
            fixed=tuple(name for name in self.fixed if name not in counted),
            held=tuple(parameter for parameter in self.held if parameter[0] not in counted),
            counted=tuple(counted),
        )

    def folded(self, arm: AnyArm) -> tuple[tuple[str, ...], FloatArray]:
        """The same errors as parameters of the calibrated URDF.

        Args:
            arm: the calibrated arm.

        Returns:
            Names (m,) of placement parameters of ``arm``, nominal there, then those beside
            geometry; and F (m, m') with ``F Fᵀ`` their covariance.

        Raises:
            InputError: the arm is not the one that was calibrated.
        """
        rows: list[str] = []
        blocks: list[FloatArray] = []
        estimated = [arm.offered[name] for name in self.names]
        for joint, segment in placed_joints(arm):
            if any(p.owner == segment.owner and p.geometric for p in estimated):
                self._check_same(joint, segment)
                rows += segment.names(*PLACEMENT)
                blocks.append(self._of_joint(joint, segment))
        beside = (p.name for p in estimated if not p.geometric)
        for name in dict.fromkeys([*self.beside_geometry, *beside]):
            rows.append(name)
            blocks.append(np.array([[float(n == name) for n in self.names]]))
        derivative = np.vstack([np.zeros((0, len(self.names))), *blocks])
        # Also where rounding made the covariance not quite positive.
        values, vectors = np.linalg.eigh((self.covariance + self.covariance.T) / 2)
        return tuple(rows), derivative @ (vectors * np.sqrt(np.maximum(values, 0.0)))

    def _of_joint(self, joint: ChainJoint, segment: Segment) -> FloatArray:
        """(6, n) change of the calibrated joint's placement per change of each parameter."""
        names = segment.names(*PLACEMENT, OFFSET)
        *vector, offset = (self.values.get(name, 0.0) for name in names[3:])
        nominal = _unfolded(joint, np.array(vector), offset)
        start = np.array([*nominal.xyz, *vector, offset])

        def calibrated(x: FloatArray) -> tuple[FloatArray, FloatArray]:
            xyz, rpy = folded_origin(nominal, x[:3], x[3:6], float(x[6]))
            return xyz, rotation_from_rpy(rpy)

        columns, step = np.zeros((6, len(self.names))), 1e-5
        for name, along in zip(names, step * np.eye(7), strict=True):
            if name in self.names:
                (p0, R0), (p1, R1) = calibrated(start - along), calibrated(start + along)
                change = np.concatenate([p1 - p0, vector_from_rotation(R0.T @ R1)])
                columns[:, self.names.index(name)] = change / (2 * step)
        return columns

    def _check_same(self, joint: ChainJoint, segment: Segment) -> None:
        if joint.type == "prismatic":
            return  # its offset is folded into the position
        same = 1e-9
        for name, urdf_value in zip(segment.names(*POSITION), joint.xyz, strict=True):
            if abs(self.values.get(name, urdf_value) - urdf_value) > same:
                raise InputError(
                    f"{self.values[name]:.9g} m, but {urdf_value:.9g} m in the URDF",
                    "the result of the calibration that wrote this URDF",
                    file=self.path,
                    where=name,
                    hint="give the calibrated.urdf from the same folder, not the nominal one",
                )


def _square(spread: Mapping[str, float], names: Sequence[str]) -> FloatArray:
    """Covariance (n, n) of parameters that go with one another."""
    root = np.array([spread.get(name, 0.0) for name in names])
    return np.outer(root, root)


def read_uncertainty(
    path: str | Path, arm: AnyArm, *, anyway: bool = False
) -> CalibrationUncertainty:
    """Read the ``result.json`` that ``suta-calib calibrate`` wrote beside the calibrated URDF.

    Args:
        path: the file.
        arm: the calibrated arm.
        anyway: take a result that says of itself that it must not be used.

    Raises:
        InputError: unreadable, not such a result, not converged, not to be used, or of another
            arm.
    """
    path = Path(path)
    data = read_json_object(path)
    parameters = data.get("parameters")
    if not isinstance(parameters, dict) or not all(
        isinstance(e, dict) for e in parameters.values()
    ):
        expected = "a result.json of suta-calib calibrate"
        raise InputError("no table of parameters", expected, file=path)
    if data.get("status") != "converged":
        raise InputError(
            f"{data.get('status')!r}",
            "'converged': the result of a calibration that did not converge is not usable",
            file=path,
            where="status",
        )
    refuse_unusable(data, path, anyway=anyway)
    offered = set(arm.offered.names)
    if leaning := [name for name in parameters if is_share(name) and name not in offered]:
        raise InputError(
            f"{leaning[0]}: tilt sensors correct this arm in every row",
            "an arm whose tip follows from its joints alone: nothing here reads the sensors",
            file=path,
            where="parameters",
            hint="suta-calib validate uses them; without --result the arm is as the URDF has it",
        )
    entries = {name: entry for name, entry in parameters.items() if name in offered}
    estimated = [name for name, entry in entries.items() if entry.get("std") is not None]
    if not entries:
        raise InputError(
            f"no parameter of {arm.urdf[0].name} among {', '.join(list(parameters)[:4])}",
            "the result of this arm's calibration",
            file=path,
            where="parameters",
        )
    names, covariance, source = _covariance(data, entries, estimated, offered, path)
    _check_covariance(covariance, path, source)
    values = {n: float(numbers(e.get("value"), (), path, n)) for n, e in entries.items()}
    fixed = tuple(str(n) for n in data.get("unidentified", []) if n in offered)
    beside = {n: v for n, v in values.items() if not arm.offered[n].in_urdf(v)}
    held = tuple(
        (name, {n: factor for n, factor in direction.items() if n in offered}, plausible)
        for name, direction, plausible in _held(data, fixed, path)
    )
    return CalibrationUncertainty(path, names, covariance, values, source, fixed, beside, held)


def _held(
    data: dict[str, Any], fixed: Sequence[str], path: Path
) -> Iterator[tuple[str, Mapping[str, float], float]]:
    """What the file says of each fixed parameter; earlier versions wrote nothing."""

    def number(value: Any) -> float:
        return float(numbers(value, (), path, "held"))

    for entry in data.get("held", []):
        if not (isinstance(entry, dict) and isinstance(entry.get("direction"), dict)):
            expected = "parameter, plausible and direction of each held parameter"
            raise InputError(repr(entry), expected, file=path, where="held")
        if entry.get("parameter") in fixed:
            direction = {str(name): number(value) for name, value in entry["direction"].items()}
            yield str(entry["parameter"]), direction, number(entry.get("plausible"))


def _covariance(
    data: dict[str, Any],
    entries: dict[str, dict[str, Any]],
    estimated: Sequence[str],
    offered: Set[str],
    path: Path,
) -> tuple[tuple[str, ...], FloatArray, Source]:
    for source in ("covariance", "correlations"):
        table = data.get(source)
        if not isinstance(table, dict) or not table.get("parameters"):
            continue
        names = tuple(map(str, table["parameters"]))
        shape = (len(names), len(names))
        matrix = numbers(table.get("matrix"), shape, path, f"{source}: matrix")
        # What a job holds without naming it may be among them.
        of_table: Set[str] = entries.keys() if source == "correlations" else offered
        metrics = data.get("metrics")
        if isinstance(metrics, dict) and "by_chain" in metrics:
            # Of a robot with several chains, where the arm may be one of them.
            chosen = [k for k, name in enumerate(names) if name in of_table]
            names, matrix = tuple(names[k] for k in chosen), matrix[np.ix_(chosen, chosen)]
        if missing := [name for name in names if name not in of_table]:
            where = f"{source}: parameters"
            raise InputError(repr(missing[0]), "a parameter of this arm", file=path, where=where)
        if source == "covariance":
            return names, matrix, "covariance"
        std = np.array([numbers(entries[n].get("std"), (), path, n) for n in names])
        return names, matrix * np.outer(std, std), "correlations"
    std = np.array([numbers(entries[name]["std"], (), path, name) for name in estimated])
    return tuple(estimated), np.diag(std**2), "std"


def _check_covariance(covariance: FloatArray, path: Path, source: Source) -> None:
    """Refuse what is no covariance of lengths and angles, whatever it is called in the file."""
    variances = np.diag(covariance)
    problem = ""
    if np.abs(covariance).max(initial=0.0) > FARTHEST**2:
        problem = f"a standard deviation of {np.sqrt(np.abs(covariance).max()):.3g} m or rad"
    elif variances.min(initial=0.0) < 0:
        problem = f"a variance of {variances.min():.3g}"
    elif not np.allclose(covariance, covariance.T, 1e-6, 1e-9 * variances.max(initial=0.0)):
        problem = "a matrix that is not symmetric"
    if problem:
        expected = "the covariance that suta-calib calibrate wrote"
        raise InputError(problem, expected, file=path, where=source)


def _unfolded(joint: ChainJoint, vector: FloatArray, offset: float) -> ChainJoint:
    """The joint as it was before its offset and turn were folded into its origin."""
    R = rotation_from_rpy(joint.rpy)
    turn = joint.axis * (offset if joint.type in ("revolute", "continuous") else 0.0)
    turned = R @ rotation_from_vector(-turn)
    slide = turned @ joint.axis * offset if joint.type == "prismatic" else np.zeros(3)
    rpy = rpy_from_rotation(turned @ rotation_from_vector(-vector))
    return replace(joint, xyz=joint.xyz - slide, rpy=rpy)


# ── JSON of earlier commands ────────────────────────────────────────────────────────────────
def read_json_object(path: Path) -> dict[str, Any]:
    """The one JSON object in a file.

    Where a run was killed while it replaced the files of the folder, that is finished first.

    Raises:
        InputError: no such file, not JSON (with the line), or something else than an object.
    """
    recover(path.parent)
    try:
        data = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(
            f"text that is not JSON ({error.msg})", "a JSON object", file=path, line=error.lineno
        ) from None
    if not isinstance(data, dict):
        raise InputError(f"a JSON {type(data).__name__}", "a JSON object", file=path)
    return data


def numbers(data: Any, shape: tuple[int, ...], path: Path, where: str) -> FloatArray:
    """Finite numbers of a given shape; an InputError of anything else."""
    try:
        values = np.array(data, dtype=float)
    except (TypeError, ValueError):
        values = np.full(1, np.nan)
    if values.shape != shape or not np.isfinite(values).all():
        expected = f"{' x '.join(map(str, shape))} finite numbers"
        text = repr(data)
        raise InputError(
            text if len(text) <= 60 else text[:57] + "…", expected, file=path, where=where
        )
    return values
