"""Poses with known truth, written as other programs would, to be read back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.exchange import ImportedRows, Result, read_foreign, write_foreign
from suta_calib.exchange.result import CalibratedArm
from suta_calib.measurements import has_rotations, positions, read_csv_table, rotations
from suta_calib.model.arm import ArmModel
from suta_calib.tracking.uncertainty import CalibrationUncertainty


def poses(n: int = 12, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Rotations (n, 3, 3) and positions (n, 3), m, a metre and a half from the instrument."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.from_rotvec(rng.uniform(-1.2, 1.2, (n, 3))).as_matrix()
    away = np.array([0.1, -0.2, 1.5])
    return rotation, away + rng.uniform(-0.4, 0.4, (n, 3))


def transforms(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """(n, 4, 4)."""
    found = np.zeros((len(position), 4, 4))
    found[:, :3, :3], found[:, :3, 3], found[:, 3, 3] = rotation, position, 1.0
    return found


def written(
    path: Path, rows: FloatArray, separator: str = ",", header: str = "", decimal: str = "."
) -> Path:
    """A table of numbers with all their digits."""
    lines = [separator.join(repr(float(v)).replace(".", decimal) for v in row) for row in rows]
    path.write_text("\n".join([*([header] if header else []), *lines]) + "\n", encoding="utf-8")
    return path


def imported(path: Path, form: str | None = None, **options: object) -> ImportedRows:
    """What a file is read as, which must be rows."""
    found = read_foreign(path, form, **options)
    assert isinstance(found, ImportedRows)
    return found


def read_back(
    found: ImportedRows, path: Path, prefix: str = ""
) -> tuple[FloatArray | None, FloatArray]:
    """The rotations and positions that the package's own reader finds in what was imported."""
    found.write(path)
    table = read_csv_table(path)
    rotation = rotations(table, prefix) if has_rotations(table, prefix) else None
    return rotation, positions(table, prefix)


def check(
    found: ImportedRows,
    path: Path,
    rotation: FloatArray | None,
    position: FloatArray,
    prefix: str = "",
) -> None:
    """Whether the poses are those, to a nanometre."""
    R, p = read_back(found, path, prefix)
    np.testing.assert_allclose(p, position, rtol=0, atol=1e-9)
    if rotation is None:
        assert R is None
    else:
        assert R is not None
        np.testing.assert_allclose(R, rotation, rtol=0, atol=1e-9)


def result_of(arm: ArmModel, values: Mapping[str, float], path: Path) -> Result:
    """A calibration with these values, of which nothing was estimated."""
    answer = CalibrationUncertainty(path, (), np.zeros((0, 0)), dict(values), "none", (), {})
    return Result(path, CalibratedArm(arm, answer), (), {}, {})


def exported(result: Result, form: str, folder: Path, **options: object) -> Path:
    """The file that a result becomes."""
    made = write_foreign(result, form, **options)
    return made.write(folder / made.file)[0]
