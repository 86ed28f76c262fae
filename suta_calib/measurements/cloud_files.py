"""Clouds of points: PLY, PCD and NPY.

PLY is read by trimesh. PCD is a header in text and rows behind it; libraries that read it bring
much that is not needed, so it is read here.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.measurements.files import read_bytes
from suta_calib.measurements.pose_files import FAR
from suta_calib.optional_packages import load

SUFFIXES: Final = frozenset({".ply", ".pcd", ".npy"})
_PCD_TYPES: Final = {"F": "f", "I": "i", "U": "u"}


@dataclass(frozen=True, eq=False)
class Cloud(Displayable):
    """Points that were seen from the origin.

    Attributes:
        points: (n, 3), m.
        dropped: how many more have no place: coordinates that are zero or not finite.
        outside: how many more are nearer or farther than what counts.
    """

    points: FloatArray
    dropped: int
    outside: int = 0

    @property
    def count(self) -> int:
        """Of all points."""
        return len(self.points) + self.dropped + self.outside

    @classmethod
    def of(cls, raw: Any, step: float, path: Path, hint: str) -> Cloud:
        """Rows (n, 3), of which some have no place, in units of ``step``, m.

        Raises:
            InputError: without points, or in another unit; ``hint`` is what to do then.
        """
        rows = np.asarray(raw, dtype=float).reshape(-1, 3)
        there = np.isfinite(rows).all(axis=1) & rows.any(axis=1)
        if not there.any():
            what = f"{len(rows)} points, all of them zero or not finite" if len(rows) else "none"
            raise InputError(f"a cloud without points ({what})", "points in front of it", file=path)
        points = np.asarray(rows[there] * step, dtype=np.float64)
        away = float(np.median(np.linalg.norm(points, axis=1)))
        # What is nearer no depth camera sees, m.
        if not 0.02 <= away <= FAR:
            looks = "it looks like mm" if away > FAR else "it looks like m, read in a smaller unit"
            raise InputError(
                f"points {away:.3g} m away (median)",
                "a cloud in m",
                file=path,
                hint=f"{looks}: {hint}",
            )
        return cls(points, int(np.sum(~there)))


def read_cloud(path: Path, unit: float | None = None) -> Cloud:
    """A cloud of points.

    Args:
        path: of a .ply, .pcd or .npy file: (n, 3) or (height, width, 3), or fields x, y and z.
        unit: m of one unit of the file; by default m.

    Raises:
        InputError: not readable, no such file, without points, or in mm where m are expected.
        MissingExtraError: trimesh is not installed, which reads PLY.
    """
    readers = {".ply": _ply, ".pcd": _pcd, ".npy": _npy}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"a file {path.suffix or 'without a suffix'}", "a cloud: .ply, .pcd or .npy", file=path
        )
    data = read_bytes(path)
    if not data:
        raise InputError("an empty file", "a cloud of points", file=path)
    try:
        raw = reader(data)
    # What readers raise about a file that is cut off or of another kind.
    except (ValueError, IndexError, KeyError, EOFError, TypeError, OverflowError) as problem:
        raise InputError(
            f"a file that cannot be read ({type(problem).__name__}: {problem})",
            f"a cloud as {path.suffix.lower()[1:].upper()}, with x, y and z",
            file=path,
        ) from None
    hint = "give --unit mm" if unit is None else "check --unit"
    return Cloud.of(raw, 1.0 if unit is None else unit, path, hint)


def _ply(data: bytes) -> Any:
    return load("trimesh.exchange.ply", "formats").load_ply(io.BytesIO(data))["vertices"]


def _npy(data: bytes) -> Any:
    array = np.load(io.BytesIO(data), allow_pickle=False)
    if array.dtype.names is not None:
        return np.stack([array[axis] for axis in "xyz"], axis=-1)
    if array.ndim < 2 or array.shape[-1] < 3 or array.dtype.kind not in "fiu":
        raise ValueError(f"{array.dtype} numbers of shape {array.shape}, not (n, 3)")
    # What follows x, y and z is a colour or a brightness.
    return array[..., :3]


def _pcd(data: bytes) -> Any:
    """Rows of a PCD file: pointclouds.org/documentation/tutorials/pcd_file_format.html."""
    header, start = dict[str, list[str]](), 0
    while "DATA" not in header:
        end = data.find(b"\n", start)
        if end < 0:
            raise ValueError("no line DATA: not a PCD file, or an incomplete one")
        words = data[start:end].decode("ascii", "replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    names, sizes, types = (header[key] for key in ("FIELDS", "SIZE", "TYPE"))
    repeats = [int(count) for count in header.get("COUNT", ["1"] * len(names))]
    width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
    count, (how, *_) = width * height, header["DATA"]
    # A camera of 4k has as many points; a header may claim more, and fill the memory.
    if not 0 <= count <= 20_000_000 or not len(names) == len(sizes) == len(types) == len(repeats):
        raise ValueError(f"a header of {count} points with {len(names)} fields")
    formats = [f"<{_PCD_TYPES[t]}{size}" for t, size in zip(types, sizes, strict=True)]
    if how == "ascii":
        places = np.cumsum([0, *repeats])
        columns = [int(places[names.index(axis)]) for axis in "xyz"]
        rows = [line.split() for line in data[start:].decode("ascii").splitlines() if line.strip()]
        if len(rows) != count:
            raise ValueError(f"{len(rows)} rows where the header says {count}")
        return np.array([[float(row[column]) for column in columns] for row in rows])
    fields = [(f"{k}", f, (n,)) for k, (f, n) in enumerate(zip(formats, repeats, strict=True))]
    where = [f"{names.index(axis)}" for axis in "xyz"]
    if how == "binary":
        table = np.frombuffer(data, np.dtype(fields), count, start)
        return np.stack([table[axis][:, 0] for axis in where], axis=-1)
    if how != "binary_compressed":
        raise ValueError(f"DATA {how}, not ascii, binary or binary_compressed")
    packed, size = (int(x) for x in np.frombuffer(data, "<u4", 2, start))
    record = np.dtype(fields).itemsize
    if size != count * record or len(data) < start + 8 + packed:
        raise ValueError(f"{size} bytes where the header says {count * record}")
    # Column by column, not row by row.
    plain, at, by_name = (
        _lzf(data[start + 8 : start + 8 + packed], size),
        0,
        dict[str, NDArray[Any]](),
    )
    for name, form, repeat in zip(names, formats, repeats, strict=True):
        by_name[name] = np.frombuffer(plain, form, count * repeat, at)[::repeat]
        at += count * repeat * np.dtype(form).itemsize
    return np.stack([by_name[axis] for axis in "xyz"], axis=-1)


def _lzf(packed: bytes, size: int) -> bytes:
    """Unpack LZF, of which PCD's compressed clouds are made (Lehmann, liblzf)."""
    out, at = bytearray(), 0
    while at < len(packed) and len(out) < size:
        control = packed[at]
        at += 1
        if control < 32:
            # As many bytes as they are.
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        begin = len(out) - ((control & 31) << 8) - packed[at] - 1
        at += 1
        if begin < 0:
            raise ValueError("compressed data that refer to nothing")
        # What was there before, which may be what is being written.
        for k in range(length + 2):
            out.append(out[begin + k])
    if len(out) != size:
        raise ValueError(f"{len(out)} bytes unpacked where {size} are expected")
    return bytes(out)
