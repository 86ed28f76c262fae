"""Samples: what the encoders read, with what was seen or touched at that moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from suta_calib import plotting
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.numbers import are_rotations
from suta_calib.geometry.travel import Said, travel_of
from suta_calib.measurements.motion import JointMotion, TimedRows, motion_of
from suta_calib.plotting.look import MOST_LABELLED
from suta_calib.plotting.scene import PlacedPoints, Posable, Scene, drawn_rows
from suta_calib.units import FARTHEST, REFERENCE_TEMPERATURE

# Label column of rows that an arm passed through in one stroke of a motion without stops.
STROKE: Final = "stroke"
Array = TypeVar("Array", bound=NDArray[Any])
# What an arm may be, °C; kelvins are beyond.
TEMPERATURES: Final = (-60.0, 150.0)
# Attributes that have a row for each sample, where they are there at all.
_BY_ROW: Final = (
    *("q", "position", "rotation", "pixels", "direction", "temperature", "payload"),
    *("position_sigma", "time", "travel"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Displayable):
    """Joint readings with their labels and, for some kinds, measured poses. Immutable.

    Attributes:
        joints: names of the joints, in the order of the columns of ``q``.
        q: (n, n_joints) raw readings, rad (m for prismatic joints).
        labels: label columns by name, each (n,), such as ``placement``.
        position: (n, 3) measured positions, m, or None. Whose and in which frame depends on the
            kind of observation.
        rotation: (n, 3, 3) measured orientations, or None.
        pixels: (n, points, 2) where the points of a board were seen, px, in the order of its
            numbers; NaN for those that were not; or None.
        origin: where each row came from, such as ``file.csv:12``; ``row 0``, ``row 1``, … where
            nobody says.
        numbers: other measured numbers by name, each (n,), in SI: lengths in m, angles in rad.
        direction: (n, n_joints) of each joint's last motion before it was read, 1 towards larger
            readings, -1 towards smaller ones, 0 where nobody says; None where nobody ever says.
        temperature: (n,) of the arm, °C; None where nobody says.
        payload: (n, 4) mass that the tip carries, kg, and its centre in the frame of the tip, m;
            None where nobody says.
        position_sigma: (n, 3) standard deviation of each coordinate of ``position``, m; None where
            nobody says.
        felt: (n, 3) what accelerometers on links felt, in any unit, by their three columns, such as
            ``base_ax,base_ay,base_az``; zeros where one has no reading.
        time: (n,) when each row was taken, s, on the clock of whoever read the joints; None where
            nobody says.
        travel: (n, n_joints, `TURNS`) where each joint came from in its recording, as the
            readings and the times tell (`travel_of`); None without times.
        motion: how the arm moved between the rows, where that has been asked for.
    """

    joints: tuple[str, ...]
    q: FloatArray
    labels: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    position: FloatArray | None = None
    rotation: FloatArray | None = None
    origin: Sequence[str] = ()
    pixels: FloatArray | None = None
    numbers: Mapping[str, FloatArray] = field(default_factory=dict)
    direction: FloatArray | None = None
    temperature: FloatArray | None = None
    position_sigma: FloatArray | None = None
    payload: FloatArray | None = None
    felt: Mapping[str, FloatArray] = field(default_factory=dict)
    time: FloatArray | None = None
    travel: FloatArray | None = None
    motion: JointMotion | None = None

    def __post_init__(self) -> None:
        if not self.origin:
            object.__setattr__(self, "origin", tuple(map("row {}".format, range(len(self.q)))))

    def __len__(self) -> int:
        return len(self.q)

    @property
    def conditions(self) -> dict[Said, FloatArray]:
        """What is said of the arm beside its readings.

        `direction`, K above 20 °C, (n, 1), `payload`, and `travel`, joint by joint side by side.
        """
        columns: dict[Said, FloatArray] = {}
        if self.direction is not None:
            columns["direction"] = self.direction
        if self.temperature is not None:
            columns["warmth"] = self.temperature[:, None] - REFERENCE_TEMPERATURE
        if self.payload is not None:
            columns["payload"] = self.payload
        if self.travel is not None:
            columns["travel"] = self.travel.reshape(len(self), -1)
        return columns

    @classmethod
    def from_arrays(
        cls,
        joints: Sequence[str],
        q: ArrayLike,
        *,
        labels: Mapping[str, Sequence[str] | NDArray[np.str_]] | None = None,
        position: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        origin: Sequence[str] | None = None,
        numbers: Mapping[str, ArrayLike] | None = None,
        direction: ArrayLike | None = None,
        temperature: ArrayLike | None = None,
        position_sigma: ArrayLike | None = None,
        pixels: ArrayLike | None = None,
        payload: ArrayLike | None = None,
        felt: Mapping[str, ArrayLike] | None = None,
        time: ArrayLike | None = None,
    ) -> Samples:
        """Samples from copies of arrays, checked; shapes and units as the class's attributes.

        With a time the rows are a recording in motion, in the order of the rows; where it goes
        back, another one begins.
        Whether readings can be rad or m only the arm can say: `ArmPoses` refuses degrees,
        millimetres, and joints in another order than the arm's.

        Raises:
            SamplesError: a shape does not fit, or a value is not finite, empty, not a rotation, no
                direction, no temperature of an arm, a mass below zero or, of a length or a standard
                deviation, not positive.
        """
        if len(set(joints)) != len(joints):
            raise SamplesError(f"joints {', '.join(joints)}", "each name only once", where="joints")
        n = len(np.atleast_1d(numbers_of("q", q)))
        if n == 0:
            raise SamplesError("no samples", "at least one", where="q")
        origin = () if origin is None else tuple(origin)
        if origin and len(origin) != n:
            raise SamplesError(f"{len(origin)} entries", f"{n}, one per row of q", where="origin")
        readings = finite("q", q, (n, len(joints)))
        times = None if time is None else finite("time", time, (n,))
        return cls(
            tuple(joints),
            readings,
            {name: _labels(name, values, n) for name, values in (labels or {}).items()},
            None if position is None else _positions(position, n),
            None if rotation is None else _rotations(rotation, n),
            origin,
            pixels=None if pixels is None else _pixels(pixels, n),
            numbers={name: finite(name, v, (n,)) for name, v in (numbers or {}).items()},
            direction=None if direction is None else _directions(direction, (n, len(joints))),
            temperature=None if temperature is None else _temperatures(temperature, n),
            position_sigma=None
            if position_sigma is None
            else positive("position_sigma", position_sigma, (n, 3)),
            payload=None if payload is None else _payloads(payload, n),
            felt={name: finite(name, v, (n, 3)) for name, v in (felt or {}).items()},
            time=times,
            travel=None if times is None else _frozen(travel_of(readings, times)),
        )

    def scene(self, arm: Posable) -> Scene:
        """Where an arm's tip was, by the first label column, and the arm in the first sample.

        Args:
            arm: its joints are those of the samples, in any order.

        Raises:
            SamplesError: the samples are of another arm.
        """
        if set(arm.joints) != set(self.joints):
            raise SamplesError(
                f"samples of {', '.join(self.joints)}", f"samples of {', '.join(arm.joints)}"
            )
        rows = drawn_rows(len(self))
        q = self.q[:, [self.joints.index(name) for name in arm.joints]]
        position = arm.forward(q[rows])[1]
        parts = [PlacedPoints("tip in the samples", "touched", position)]
        for column, values in self.labels.items():
            names, which = np.unique(values[rows], return_inverse=True)
            if len(names) <= MOST_LABELLED:
                middles = [np.median(position[which == k], axis=0) for k in range(len(names))]
                labels = tuple(str(name) for name in names)
                parts.append(PlacedPoints(column, "place", np.array(middles), labels))
                break
        return arm.scene(q[0]) + Scene(tuple(parts))

    def plot(self, arm: Posable, ax: Any = None) -> Any:
        """Draw where an arm's tip was in three dimensions, mm, and the arm in the first sample.

        Args:
            arm: an `ArmModel` with the joints of these samples.
            ax: `Axes3D` to draw on; those of a new figure by default.

        Returns:
            The `Axes3D`.

        Raises:
            SamplesError: the samples are of another arm.
        """
        return plotting.draw_scene(self.scene(arm), ax)

    @property
    def in_a_line(self) -> str:
        """How many, of what."""
        also = [n for n in ("position", "rotation", "pixels") if getattr(self, n) is not None]
        columns = ", ".join((*self.labels, *self.numbers, *also))
        return f"{len(self)} of {len(self.joints)} joints" + (f" with {columns}" if columns else "")

    def as_keys(self) -> list[bytes]:
        """Readings and what was seen with them, row by row, as something to compare."""
        return [row.tobytes() for row in self._compared]

    @property
    def file_names(self) -> NDArray[np.str_]:
        """(n,) what `origin` says before the line; empty where rows come from no file."""
        return np.array([origin.rpartition(":")[0] for origin in self.origin], dtype=np.str_)

    def files(self) -> Iterator[tuple[int, str]]:
        """Number and name of the file of every row."""
        file, last, line = 0, "", 0
        for origin in self.origin:
            name, _, number = origin.rpartition(":")
            at = int(number) if number.isdigit() else line + 1
            # Files of one name in two folders are told by their lines, which begin again.
            file += name != last or at <= line
            last, line = name, at
            yield file, name or "the samples"

    def in_motion(self, turning: BoolArray) -> Samples:
        """The same with how the arm moved between the rows, by the times that they have.

        Args:
            turning: (joints,) joints that are where they were after a full turn of their reading.

        Raises:
            SamplesError: no times, or such that tell nothing of the motion between the rows.
        """
        if self.time is None:
            hint = "without it, remove time_offset_ms"
            raise SamplesError("no time", "when each row was taken, in s", where="time", hint=hint)
        files = np.array([file for file, _ in self.files()], dtype=np.intp)
        rows = TimedRows(self.time, self.q, files, self.origin)
        return replace(self, motion=motion_of(rows, turning))

    def hashes(self) -> NDArray[np.uint64]:
        """(n,) equal where `as_keys` are, and hardly ever elsewhere; much faster."""
        return hashed(self._compared)

    @property
    def _compared(self) -> FloatArray:
        measured = [a for a in (self.q, self.position, self.rotation, self.pixels) if a is not None]
        parts = [array.reshape(len(array), int(np.prod(array.shape[1:]))) for array in measured]
        return np.hstack([*parts, *(lengths[:, None] for lengths in self.numbers.values())])

    @classmethod
    def concatenate(cls, parts: Sequence[Samples]) -> Samples:
        """Samples one after the other; joints and kinds of columns must be those of the first.

        Raises:
            SamplesError: no parts, or parts with different joints, labels, positions or
                orientations.
        """
        kinds = {
            (
                *(part.joints, *map(frozenset, (part.labels, part.numbers, part.felt))),
                *(getattr(part, name) is None for name in _BY_ROW),
                None if part.pixels is None else part.pixels.shape[1:],
            )
            for part in parts
        }
        if len(kinds) != 1:
            raise SamplesError(
                "parts with different columns", "one or more parts with the same columns"
            )
        if len(parts) == 1:
            return parts[0]
        origin = tuple(origin for part in parts for origin in part.origin)
        return cls._made(parts, np.concatenate, origin)

    def over_joints(self, joints: Sequence[str]) -> Samples:
        """The same with columns for more joints; zero, and no direction, where there were none.

        Args:
            joints: in the order of the new columns; those of the samples are among them.
        """
        if tuple(joints) == self.joints:
            return self
        places = [joints.index(name) for name in self.joints]

        def wider(columns: FloatArray) -> FloatArray:
            array = np.zeros((len(self), len(joints), *columns.shape[2:]))
            array[:, places] = columns
            return _frozen(array)

        direction, travel = (
            None if columns is None else wider(columns) for columns in (self.direction, self.travel)
        )
        motion = self.motion and self.motion.over_joints(np.array(places), len(joints))
        wide = replace(self, q=wider(self.q), direction=direction, travel=travel)
        return replace(wide, joints=tuple(joints), motion=motion)

    def take(self, index: ArrayLike | slice) -> Samples:
        """Rows by number (repeats allowed, as in a bootstrap), by boolean mask or by slice."""
        rows = np.arange(len(self))[index if isinstance(index, slice) else np.asarray(index)]
        origin = tuple(self.origin[row] for row in rows)
        taken = self._made([self], lambda arrays: arrays[0][rows], origin)
        return taken if self.motion is None else replace(taken, motion=self.motion.take(rows))

    @classmethod
    def _made(
        cls,
        parts: Sequence[Samples],
        make: Callable[[list[NDArray[Any]]], NDArray[Any]],
        origin: tuple[str, ...],
    ) -> Samples:
        """What ``make`` makes of each array of parts that have the same columns."""
        first = parts[0]
        arrays: dict[str, Any] = {
            name: _frozen(make([getattr(part, name) for part in parts]))
            for name in _BY_ROW
            if getattr(first, name) is not None
        }
        for columns in ("labels", "numbers", "felt"):
            arrays[columns] = {
                name: _frozen(make([getattr(part, columns)[name] for part in parts]))
                for name in getattr(first, columns)
            }
        return cls(first.joints, origin=origin, **arrays)


def hashed(rows: FloatArray) -> NDArray[np.uint64]:
    """(n,) equal where rows (n, k) are to the last digit, and hardly ever elsewhere."""
    odd_factors = np.random.default_rng(0).integers(0, 2**63, rows.shape[1], np.uint64) * 2 + 1
    return np.asarray(np.ascontiguousarray(rows).view(np.uint64) @ odd_factors)


def joined(labels: Mapping[str, NDArray[np.str_]], columns: Sequence[str]) -> NDArray[np.str_]:
    """(n,) values of label columns, joined by a slash: ``P1/2`` for a placement and a repeat."""
    names = labels[columns[0]]
    for column in columns[1:]:
        names = np.char.add(np.char.add(names, "/"), labels[column])
    return names


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


def numbers_of(name: str, values: ArrayLike) -> FloatArray:
    """A copy of numbers of any shape; what a masked array hides is none."""
    try:
        array = np.array(values)
        if isinstance(values, np.ma.MaskedArray):
            array = np.where(np.ma.getmaskarray(values), np.nan, array)
        if array.dtype.kind in "cmM":
            raise TypeError(f"values of type {array.dtype}")
        return array.astype(float)
    except (TypeError, ValueError) as problem:
        raise SamplesError(f"no array of numbers ({problem})", where=name) from None


def finite(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Read-only copy as finite numbers of a shape."""
    array = numbers_of(name, values)
    if array.shape != shape:
        raise SamplesError(f"shape {array.shape}", f"shape {shape}", where=name)
    return _frozen(_checked(name, array, ~np.isfinite(array), "a finite number"))


def _checked(
    name: str, array: FloatArray, wrong: NDArray[np.bool_], expected: str, hint: str = ""
) -> FloatArray:
    """The array, if none of its numbers is wrong."""
    for index in np.argwhere(wrong):
        place = f"{name}[{', '.join(map(str, index))}]"
        raise SamplesError(f"{array[tuple(index)]:g}", expected, where=place, hint=hint)
    return array


def positive(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """`finite`, and all numbers greater than zero."""
    array = finite(name, values, shape)
    return _checked(name, array, array <= 0.0, "a number greater than 0")


def _positions(values: ArrayLike, n: int) -> FloatArray:
    position, hint = (
        finite("position", values, (n, 3)),
        ("if these are coordinates of a grid, subtract an origin"),
    )
    far = np.abs(position) > FARTHEST
    return _checked("position", position, far, f"m, within {FARTHEST:g}", hint)


def _directions(values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    direction = finite("direction", values, shape)
    return _checked("direction", direction, ~np.isin(direction, (-1.0, 0.0, 1.0)), "-1, 0 or 1")


def _temperatures(values: ArrayLike, n: int) -> FloatArray:
    temperature, (low, high) = finite("temperature", values, (n,)), TEMPERATURES
    beyond = (temperature < low) | (temperature > high)
    return _checked("temperature", temperature, beyond, f"°C, from {low:g} to {high:g}")


def _payloads(values: ArrayLike, n: int) -> FloatArray:
    """(n, 4) kg and m."""
    payload = finite("payload", values, (n, 4))
    mass, centre = np.zeros((n, 4), dtype=bool), np.abs(payload) > FARTHEST
    mass[:, 0] = payload[:, 0] < 0
    payload = _checked("payload", payload, mass, "a mass in kg, 0 or more")
    return _checked("payload", payload, centre, f"kg or m, within {FARTHEST:g}")


def _pixels(values: ArrayLike, n: int) -> FloatArray:
    array = numbers_of("pixels", values)
    if array.ndim != 3 or (len(array), array.shape[2]) != (n, 2):
        raise SamplesError(f"shape {array.shape}", f"shape ({n}, points, 2)", where="pixels")
    for index in np.argwhere(np.isinf(array) | (np.isnan(array) != np.isnan(array[..., ::-1]))):
        place = f"pixels[{', '.join(map(str, index))}]"
        raise SamplesError(str(array[tuple(index)]), "two numbers, or NaN twice", where=place)
    return _frozen(array)


def _labels(name: str, values: Sequence[str] | NDArray[np.str_], n: int) -> NDArray[np.str_]:
    if not isinstance(values, np.ndarray) or values.dtype.kind != "U":
        values = np.array([str(value) for value in values], dtype=np.str_)
    array = np.char.strip(values)
    if array.shape != (n,):
        raise SamplesError(f"{len(array)} labels", f"{n}, one per row of q", where=name)
    broken = (array == "") | (np.char.find(array, "\n") >= 0) | (np.char.find(array, "\r") >= 0)
    for row in np.flatnonzero(broken):
        raise SamplesError(repr(str(array[row])), "a label on one line", where=f"{name}[{row}]")
    return _frozen(array)


def _rotations(values: ArrayLike, n: int) -> FloatArray:
    rotation = finite("rotation", values, (n, 3, 3))
    for row in np.flatnonzero(~are_rotations(rotation)):
        raise _no_rotation(f"rotation[{row}]")
    return rotation


def _no_rotation(where: str) -> SamplesError:
    return SamplesError(
        "a matrix that is not a rotation matrix", "orthonormal, right-handed", where=where
    )


def rotation_matrix(name: str, values: ArrayLike) -> FloatArray:
    """Read-only copy (3, 3) of a rotation."""
    matrix = finite(name, values, (3, 3))
    if not are_rotations(matrix[None]).all():
        raise _no_rotation(name)
    return matrix
