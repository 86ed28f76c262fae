"""The line format of hobby and laboratory arms: ``q1,q2,…,qn`` in counts, rad or deg.

Numbers of `DeviceSpec.extra_columns` follow those of the joints. One of them may be missing: no
cell, or ``nan``.
"""

from __future__ import annotations

import math
import re
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from suta_calib.arrays import FloatArray, IntArray
from suta_calib.device.description import DeviceSpec
from suta_calib.device.formats.base import Decoder, Encoder, Format, Sample, is_text
from suta_calib.device.reading import Reading
from suta_calib.errors import WrongFormatError

_NUMBER: Final = rb"[ \t]*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?[ \t]*"
_NONE: Final = rb"[ \t]*(?:[+-]?(?:[nN][aA][nN]|[iI][nN][fF]))?[ \t]*"
_VALUES: Final = re.compile(_NUMBER + rb"(?:," + _NUMBER + rb")*")
_VALUES_OR_NONE: Final = re.compile(_NUMBER + rb"(?:,(?:" + _NUMBER + rb"|" + _NONE + rb"))*")


def encode_line(values: ArrayLike, spec: DeviceSpec, extra: ArrayLike = ()) -> bytes:
    """One line, as a device would send it.

    Args:
        values: (n,) in the device's own unit (`DeviceSpec.values`), in the order of its joints.
        spec: gives the unit: counts are written as whole numbers.
        extra: (m,) numbers of its extra columns.
    """
    form = "{:.0f}" if spec.unit == "counts" else "{:.12g}"
    cells = [form.format(value) for value in np.asarray(values).tolist()]
    cells += [f"{value:.12g}" for value in np.asarray(extra).tolist()]
    return ",".join(cells).encode() + b"\n"


def angles_from_values(
    values: FloatArray, sign: IntArray, per_turn: float | FloatArray
) -> FloatArray:
    """Joint angles (..., n) in (-π, π], rad, of any numbers less those at zero; as from counts."""
    fraction = values * sign / per_turn
    wrapped: FloatArray = (fraction - np.ceil(fraction - 0.5)) * math.tau
    return wrapped


class LinesDecoder(Decoder):
    """`Decoder` of the line format.

    What comes before the first line's end is left out: it may be the end of a longer line, and
    nothing in the format would show it. Lines have no number and no time: sequence numbers count
    the good ones, and their time is that of their arrival. A line that is no list of numbers
    counts as a damaged frame.
    """

    def __init__(self, spec: DeviceSpec) -> None:
        super().__init__(spec)
        self._turns, self._zeros = spec.turns, spec.zeros
        # A device may say a whole turn, not more: then the unit is another one. A counter of
        # several turns may be anywhere within a turn of the joint, about its zero.
        self._most = (1.0 + 1e-6) * np.abs(self._turns) + np.abs(self._zeros)
        self._longest = 40 * spec.numbers
        self._values = _VALUES_OR_NONE if spec.extra_columns else _VALUES
        self._none_raised = np.zeros(len(spec.joints), dtype=np.bool_)
        self._none_raised.setflags(write=False)
        self._whole = False  # the buffer begins where a line begins
        self._sequence = 0
        self._unfit = 0

    def feed(self, data: bytes, arrival: float) -> list[Reading]:
        """Take the next bytes and give the readings they complete."""
        self._buffer += data
        *lines, rest = self._buffer.split(b"\n")
        self._buffer = rest
        if lines and not self._whole:
            self._whole = True
            self.statistics.garbage_bytes += len(lines.pop(0)) + 1
        rows = [row for line in lines if (row := self._row(line)) is not None]
        if len(self._buffer) > self._longest:
            # Noise without an end of line must not fill the memory.
            self.statistics.garbage_bytes += len(self._buffer)
            self.resume(None)
        if not rows:
            return []
        first, flags = self._sequence, self._none_raised
        self._sequence += len(rows)
        self.statistics.frames += len(rows)
        values = np.array(rows)
        joints = len(self._zeros)
        angles = angles_from_values(values[:, :joints] - self._zeros, self._signs, self._turns)
        return [
            Reading(first + index, arrival, row, flags, flags, arrival, extra)
            for index, (row, extra) in enumerate(zip(angles, values[:, joints:], strict=True))
        ]

    def resume(self, after: Reading | None) -> None:
        """Begin anew after an interruption."""
        del after  # lines carry no clock that could have jumped
        self._buffer.clear()
        self._whole = False

    def _row(self, line: bytearray) -> list[float] | None:
        text = line.rstrip(b"\r")
        if not text.strip():
            return None
        if len(line) <= self._longest and self._values.fullmatch(text):
            row = [float(value) if value.strip() else math.nan for value in text.split(b",")]
            angles = row[: len(self._most)]
            if len(row) == self._spec.numbers and np.all(np.abs(angles) <= self._most):
                self._unfit = 0
                return row
            if not np.isnan(angles).any():
                self._refuse(row, text)
        self.statistics.frame_crc_errors += 1
        return None

    def _refuse(self, row: list[float], text: bytearray) -> None:
        self._unfit += 1
        # A damaged line may have any number of values, or any value; one after the other they do
        # not.
        if self._unfit < 3:
            return
        spec, self._unfit = self._spec, 0
        place = f"{spec.port}: found lines such as '{bytes(text[:60]).decode('ascii')}'"
        if len(row) != spec.numbers:
            listed = "'joints' and 'extra_columns'" if spec.extra_columns else "'joints'"
            more = len(row) > spec.numbers and not spec.extra_columns
            raise WrongFormatError(
                f"{place}, of {len(row)} value{'s' * (len(row) != 1)}; expected "
                f"{spec.numbers}, as many as {spec.path} lists under {listed}"
                + ("; if the last ones are no joints, name them under 'extra_columns'" * more)
            )
        raise WrongFormatError(
            f"{place}; expected at most one turn, {self._turns.max():.10g} {spec.unit}, of every "
            f"joint; check {'counts_per_turn' if spec.unit == 'counts' else 'unit'} in {spec.path}"
        )


class LinesEncoder(Encoder):
    """`Encoder` of the line format, which carries neither clock nor flags."""

    def packet(self, sample: Sample) -> bytes:
        """One line."""
        return encode_line(sample.values, self._spec, sample.extra)


class LinesFormat(Format):
    """Lines of text: a number per joint, and then those of the extra columns."""

    name: ClassVar[str] = "lines"
    decoder: ClassVar[type[Decoder]] = LinesDecoder
    encoder: ClassVar[type[Encoder]] = LinesEncoder
    units: ClassVar[tuple[str, ...]] = ("counts", "rad", "deg")
    has_clock: ClassVar[bool] = False
    geared: ClassVar[bool] = True
    extra_columns: ClassVar[bool] = True
    damaged: ClassVar[str] = "lines that cannot be read"
    damage: ClassVar[str] = "lines are not lists of numbers"

    def expected(self, numbers: int) -> str:
        """``lines of 6 numbers with commas between``."""
        return f"lines of {numbers} numbers separated by commas"

    def recognises(self, data: bytes) -> bool:
        """Printable text."""
        return is_text(data)
