"""MATLAB: variables of a ``.mat`` file that are transforms."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import read_bounded
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.option import Given
from suta_calib.exchange.pose_series import PoseSeries, imported_series
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.table_roles import UNIT
from suta_calib.exchange.tracked_bodies import BODY_OPTIONS
from suta_calib.words import listed


class MatlabReader(Reader):
    """Arrays of 4 x 4 x n or n x 4 x 4, and cells of 4 x 4; each variable is a body."""

    name = "matlab"
    summary = "MATLAB .mat (up to version 7.2): arrays 4x4xn, or cells of 4x4"
    example = "poses.mat --format matlab --body A --out poses.csv"
    options = (*BODY_OPTIONS, UNIT)
    suffixes = (".mat",)

    def recognises(self, path: Path, head: str) -> bool:
        """Its suffix says so."""
        del path, head
        return True

    def read(self, path: Path, given: Given) -> ImportedRows:
        """Every variable with transforms."""
        try:
            variables = loadmat(BytesIO(read_bounded(path)))
        except NotImplementedError:
            raise ForeignFileError(
                "a MATLAB 7.3 file, which is HDF5", "an older version", file=path, hint="save -v7"
            ) from None
        except ForeignFileError:
            raise
        except Exception as error:  # noqa: BLE001 - whatever a broken file makes SciPy raise
            reason = f"a file that cannot be read ({type(error).__name__})"
            raise ForeignFileError(reason, "a .mat file", file=path) from None
        names = [name for name in variables if not name.startswith("__")]
        series = {
            name: PoseSeries(poses[:, :3], list(range(1, len(poses) + 1)), [1] * len(poses))
            for name in names
            for poses in _transforms(np.asarray(variables[name]))
        }
        if not series:
            problem = f"no transforms among {listed(names)}" if names else "no variables"
            raise ForeignFileError(problem, "arrays of 4 x 4 x n", file=path)
        return imported_series(path, self.name, series, given)


def _transforms(value: NDArray[Any]) -> Iterator[NDArray[np.float64]]:
    """(n, 4, 4) of a variable that is such; nothing of another."""
    if value.dtype == object:
        cells = [np.asarray(cell) for cell in value.ravel()]
        if not cells or any(cell.shape != (4, 4) or cell.dtype.kind not in "fiu" for cell in cells):
            return
        value = np.stack(cells)
    elif value.dtype.kind not in "fiu":
        return
    last = np.array([0.0, 0.0, 0.0, 1.0])
    for poses in (value[None], value, np.moveaxis(value, -1, 0)):
        if poses.ndim == 3 and poses.shape[1:] == (4, 4) and np.allclose(poses[:, 3], last):
            yield poses.astype(float)
            return
