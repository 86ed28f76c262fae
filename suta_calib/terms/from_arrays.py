"""Builds a kind of observation from arrays: its columns and attributes are checked.

Nothing here is said of a kind that the kind does not say of itself: `SampleColumns` names the
arrays, the fields of the class name the rest.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from inspect import Parameter, Signature
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError, SamplesError, did_you_mean
from suta_calib.geometry.numbers import rotation_from_quaternion
from suta_calib.measurements import SampleColumns, Samples
from suta_calib.measurements.samples import numbers_of, positive
from suta_calib.terms.given_pose import GivenPose
from suta_calib.terms.poses import ArmPoses
from suta_calib.words import listed

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel

# What types that are looked into have in common.
_GENERIC: Final = re.compile(r"\[.*\]")
T = TypeVar("T")
_LABELS: Final = "a label for each row, or one for all"


class ArrayColumn(NamedTuple):
    """One array argument of a kind.

    Attributes:
        takes: its shape and unit.
        required: whether it must be given.
        about: what it holds.
    """

    takes: str
    required: bool = False
    about: str = ""


def columns_of(term: Any) -> dict[str, ArrayColumn]:
    """The arrays that a kind takes beside the readings, by keyword."""
    kind: SampleColumns = term.columns
    about = kind.about
    # Pictures need no names where each row has its own.
    named = not kind.pixels
    columns = {name: ArrayColumn(_LABELS, named, about.get(name, "")) for name in kind.labels}
    if kind.pixels:
        about_column = (
            "Pixels of the board's points, in the order of their numbers; NaN where not seen."
        )
        columns["pixels"] = ArrayColumn("(n, points, 2) in px", True, about_column)
    if kind.position:
        columns["position"] = ArrayColumn("(n, 3) in m", True, about.get("x, y, z", ""))
    if kind.orientation != "none":
        takes, needed = "(n, 4) quaternions x, y, z, w, or (n, 3, 3)", kind.orientation
        about_column = about.get("qx, qy, qz, qw", "")
        columns["orientation"] = ArrayColumn(takes, needed == "required", about_column)
    if kind.position_sigma:
        about_column = "Standard deviation of each coordinate."
        columns["position_sigma"] = ArrayColumn(
            "(n, 3) in m, or (n,), or one for all", about=about_column
        )
    for number in kind.numbers:
        takes = "(n,)" if number.unit == "1" else f"(n,) in {number.unit}"
        columns[number.name] = ArrayColumn(takes, number.required, about.get(number.name, ""))
    more = (*kind.common_labels, *kind.optional_labels)
    columns |= {name: ArrayColumn(_LABELS, about=about.get(name, "")) for name in more}
    if _sees(term):
        about_time = "When each row was taken, for time_offset."
        columns["time"] = ArrayColumn("(n,) in s", about=about_time)
    side = "1 (the joint came from smaller readings), -1 (from larger ones) or 0 (unknown)"
    return columns | {
        "direction": ArrayColumn(f"(n, joints) of {side}"),
        "temperature": ArrayColumn("(n,) in °C, or one for all", about="Of the arm."),
        "payload": ArrayColumn(
            "(n,) in kg, or (n, 4): kg and x, y, z in m",
            about="What the tip carries, and where in its frame.",
        ),
        "felt": ArrayColumn(
            "by link: (n, 3), zeros where there is no reading",
            about="What the tilt sensor of a link felt at rest, in any unit: it points up.",
        ),
        "origin": ArrayColumn("(n,) names of the rows, for messages"),
    }


def attributes_of(kind: Any) -> dict[str, Field[Any]]:
    """The other keywords of a kind: the fields of its class, but where its poses come from."""
    not_given = {"poses"} if _sees(kind) else {"poses", "time_offset"}
    return {f.name: f for f in fields(kind) if f.init and f.name not in not_given}


def _sees(kind: Any) -> bool:
    """Whether something sees an arm, which may move; an arm rests where it touches."""
    return bool(kind.medium != "touch")


class FromArrays:
    """The constructor of a kind from arrays, with the arguments that this kind takes."""

    def __get__(self, _: object, kind: type[T]) -> Callable[..., T]:
        """The constructor of this class, which help and completion show with its arguments."""

        def from_arrays(arm: ArmModel, q: ArrayLike, **given: Any) -> T:
            made: T = kind.over_arrays(*taken_from_arrays(kind, arm, q, given))  # type: ignore[attr-defined]
            return made

        if hasattr(kind, "columns"):
            from_arrays.__doc__ = _documentation(kind)
            vars(from_arrays)["__signature__"] = _signature(kind)
        return from_arrays


def _signature(kind: Any) -> Signature:
    columns, place = columns_of(kind), Parameter.POSITIONAL_OR_KEYWORD
    parameters = [Parameter("arm", place), Parameter("q", place)]
    needed = {name: column.required for name, column in columns.items()}
    needed |= {name: _required(field) for name, field in attributes_of(kind).items()}
    for name in sorted(needed, key=needed.__getitem__, reverse=True):
        default = Parameter.empty if needed[name] else None
        parameters.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default))
    return Signature(parameters)


def _documentation(kind: Any) -> str:
    lines = "".join(
        f"    {name}: {column.takes}{'' if column.required else ' (may be left out)'}. "
        f"{column.about}\n"
        for name, column in columns_of(kind).items()
    )
    return (
        f"{kind.__name__} of an arm's readings and what was observed with each of them.\n\n"
        "Args:\n    arm: whose readings they are.\n"
        "    q: (n, joints) readings in the order of the arm's joints, rad (m where they slide).\n"
        f"{lines}    {', '.join(attributes_of(kind))}: attributes of the class.\n\n"
        "Raises:\n    InputError: says which argument cannot be used, and what it should be.\n"
    )


def _required(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def taken_from_arrays(
    kind: Any, arm: ArmModel, q: ArrayLike, given: Mapping[str, Any]
) -> tuple[ArmPoses, dict[str, Any]]:
    """Poses of an arm with what was observed, and the attributes that were given to a kind.

    An InputError says which argument cannot be used, and what it should be.
    """
    # By what is asked of it: who calibrates no arm needs no Pinocchio.
    if not hasattr(arm, "joints"):
        hint = "ArmModel.from_urdf reads one"
        raise InputError(_shown(arm), "an ArmModel", where=f"{kind.kind}: arm", hint=hint)
    columns, attributes = columns_of(kind), attributes_of(kind)
    given = {name: value for name, value in given.items() if value is not None}
    for name in given:
        if name not in columns and name not in attributes:
            raise InputError(
                f"the argument {name!r}",
                f"one of {', '.join([*columns, *attributes])}",
                where=kind.kind,
                hint=did_you_mean(name, [*columns, *attributes]),
            )
    for name, column in columns.items():
        if column.required and name not in given:
            expected = f"{name}: {column.takes}"
            raise SamplesError(
                f"no {name}", expected, where=kind.kind, hint=column.about.rstrip(".")
            )
    for name, field in attributes.items():
        if _required(field) and name not in given:
            raise InputError(f"no {name}", f"{name}: {field.type}", where=kind.kind)
    chosen = {name: value for name, value in given.items() if name in attributes}
    for name, value in chosen.items():
        _check_type(kind, name, value)
    for label, pose in (chosen.get("given") or {}).items():
        if not isinstance(pose, GivenPose):
            where = f"{kind.kind}: given[{label!r}]"
            raise InputError(_shown(pose), "GivenPose", where=where)
    try:
        samples = _samples(kind.columns, arm, q, {n: v for n, v in given.items() if n in columns})
    except SamplesError as problem:
        where = f"{kind.kind}: {problem.where}" if problem.where else kind.kind
        raise SamplesError.of(problem, None, None, where) from None
    return ArmPoses(arm, samples), chosen


def _samples(kind: SampleColumns, arm: ArmModel, q: ArrayLike, given: Mapping[str, Any]) -> Samples:
    """The samples of an arm with these columns."""
    readings = numbers_of("q", q)
    expected = f"(n, {len(arm.joints)}): a row for each sample, a column for each of "
    if readings.ndim != 2 or readings.shape[1] != len(arm.joints):
        expected += ", ".join(arm.joints)
        raise SamplesError(f"shape {readings.shape}", expected, where="q")
    n = len(readings)
    names = (*kind.labels, *kind.common_labels, *kind.optional_labels)
    labels = {name: _labels(name, given[name], n) for name in names if name in given}
    if kind.pixels:
        labels = {name: [f"row {k}" for k in range(n)] for name in kind.labels} | labels
    numbers = {
        column.name: positive(column.name, given[column.name], (n,))
        if column.positive
        else given[column.name]
        for column in kind.numbers
        if column.name in given
    }
    sigma, turned = given.get("position_sigma"), given.get("orientation")
    warm, load = given.get("temperature"), given.get("payload")
    return Samples.from_arrays(
        arm.joints,
        readings,
        labels=labels,
        position=given.get("position"),
        rotation=None if turned is None else _rotations(turned),
        origin=given.get("origin"),
        numbers=numbers,
        direction=given.get("direction"),
        temperature=None if warm is None else _spread("temperature", warm, (n,)),
        position_sigma=None if sigma is None else _spread("position_sigma", sigma, (n, 3)),
        pixels=given.get("pixels"),
        payload=None if load is None else _loads(load, n),
        felt=_felt(arm, given.get("felt") or {}),
        time=given.get("time"),
    )


def _felt(arm: ArmModel, given: Any) -> dict[str, ArrayLike]:
    """What sensors felt, by their columns."""
    by_link = {sensor.link: sensor.felt for sensor in arm.tilt_sensors}
    if not isinstance(given, Mapping) or not {*given} <= {*by_link}:
        found = listed([*given]) if isinstance(given, Mapping) else _shown(given)
        expected = f"readings by link: {', '.join(by_link) or 'the arm has no tilt sensors'}"
        hint = "" if by_link else "arm.with_tilt_sensors([TiltSensor(link)]) says which it has"
        raise SamplesError(found, expected, where="felt", hint=hint)
    return {by_link[link]: vectors for link, vectors in given.items()}


def _loads(values: ArrayLike, n: int) -> FloatArray:
    """(n, 4) masses and their places; masses alone are at the tip, and one stands for all."""
    load = numbers_of("payload", values)
    if load.ndim < 2:
        masses = _spread("payload", load, (n,))
        return np.column_stack([masses, np.zeros((len(masses), 3))])
    return load


def _spread(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Numbers of a shape; one stands for all, and one for each row for all of its columns."""
    numbers = numbers_of(name, values)
    if numbers.ndim == 1 and len(shape) == 2 and len(numbers) == shape[0]:
        numbers = numbers[:, None]
    if numbers.ndim == 0 or (numbers.ndim == len(shape) == 2 and numbers.shape[1] == 1):
        return np.broadcast_to(numbers, shape)
    return numbers


def _labels(name: str, values: Any, n: int) -> list[Any]:
    """Labels of n rows; one stands for all."""
    try:
        labels = [values] * n if np.ndim(values) == 0 else [*values]
    except (TypeError, ValueError):
        raise SamplesError(_shown(values), _LABELS, where=name) from None
    for row, label in enumerate(labels):
        if label is None or (isinstance(label, Real) and not math.isfinite(label)):
            raise SamplesError(str(label), "a label", where=f"{name}[{row}]")
    return labels


def _rotations(values: ArrayLike) -> FloatArray:
    """(n, 3, 3) of matrices, which are checked later, or of quaternions (n, 4)."""
    numbers = numbers_of("orientation", values)
    if numbers.ndim != 2 or numbers.shape[1] != 4:
        return numbers
    length = np.linalg.norm(numbers, axis=1)
    # A quaternion that is farther from length one was not meant as a rotation.
    unit_norm = 0.01
    for row in np.flatnonzero(~(np.abs(length - 1.0) <= unit_norm)):
        expected = "one of length 1, in the order x, y, z, w"
        where = f"orientation[{row}]"
        raise SamplesError(f"a quaternion of length {length[row]:.3g}", expected, where=where)
    return rotation_from_quaternion(numbers / length[:, None])


def _check_type(kind: Any, name: str, value: Any) -> None:
    """Refuse an attribute of another type than its class says."""
    base = next(b for b in kind.__mro__ if name in vars(b).get("__annotations__", {}))
    declared = str(vars(base)["__annotations__"][name])
    try:
        plain = _GENERIC.sub("", declared)
        expected = eval(plain, vars(sys.modules[base.__module__]))
        fits = isinstance(value, Real if expected is float else expected)
    except (NameError, TypeError):
        return  # Arrays and literals are looked at where they are used.
    if not fits or (expected is float and not math.isfinite(value)):
        raise InputError(
            _shown(value), declared.removesuffix(" | None"), where=f"{kind.kind}: {name}"
        )


def _shown(value: Any) -> str:
    """A value in a message: short, and with its type where that is what is wrong."""
    text = repr(value)
    return f"{text[:40]} ({type(value).__name__})" if len(text) <= 40 else type(value).__name__
