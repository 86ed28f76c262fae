"""LeRobot datasets: the rests of the recorded joint states, from Parquet files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import note_input
from suta_calib.errors import ForeignFileError
from suta_calib.exchange.cells import is_folder, is_plain_file, read_json
from suta_calib.exchange.imported import ImportedRows
from suta_calib.exchange.lerobot_motors import MOTORS
from suta_calib.exchange.moving_rows import MOVING, moving_arm
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.reader import Reader
from suta_calib.exchange.recorded_rests import SECONDS, found_rests, imported_rests
from suta_calib.exchange.truncated import COMPLETE, check_count
from suta_calib.optional_packages import load
from suta_calib.units import from_deg
from suta_calib.words import listed

STATE_UNIT: Final = Option(
    "state_unit",
    "Unit of the recorded states, which the dataset does not contain.",
    choices=("deg", "rad"),
)
_STATE: Final = "observation.state"
_COLUMNS: Final = (_STATE, "timestamp", "episode_index")


class LerobotDatasetReader(Reader):
    """Every rest of every episode as a row; the states are angles, not shares of a range."""

    name = "lerobot-dataset"
    summary = "LeRobot dataset (a folder with meta/info.json): rests of its states"
    example = "my_dataset --state-unit deg --motors elbow_flex=joint_3 --out a.csv"
    options = (STATE_UNIT, MOTORS, SECONDS, MOVING, COMPLETE)
    extra = "parquet"

    def recognises(self, path: Path, head: str) -> bool:
        """A folder with meta/info.json."""
        del head
        return path.is_dir() and (path / "meta" / "info.json").is_file()

    def read(self, path: Path, given: Given) -> ImportedRows:
        """A samples CSV: joints in rad, and the time in its episode after those before it."""
        if not is_folder(path):
            problem = "a file" if is_plain_file(path) else "no such file"
            raise ForeignFileError(problem, "the folder of a dataset", file=path)
        info = read_json(path / "meta" / "info.json")
        names = _motors(path / "meta" / "info.json", info)
        unit = given.text(STATE_UNIT)
        if not unit:
            problem = "states without their unit"
            expected = "deg or rad: a share of a motor's range is not an angle"
            raise given.refuse(STATE_UNIT, problem, expected)
        time, states = self._rows(path, len(names))
        stated = info.get("total_frames")
        stated = float(stated) if isinstance(stated, int) else float("nan")
        check_count(path, len(time), stated, "frames", given)
        angles = from_deg(states) if unit == "deg" else states
        renamed = given.pairs(MOTORS)
        joints = [renamed.get(name, name) for name in names]
        if len(set(joints)) < len(joints):
            raise given.refuse(MOTORS, f"the joints {listed(joints)}", "each joint only once")
        if MOVING in given:
            return moving_arm(path, self.name, dict(zip(joints, angles.T, strict=True)), time)
        rests = found_rests(path, joints, time, angles, given)
        return imported_rests(path, self.name, joints, rests)

    def _rows(self, path: Path, count: int) -> tuple[FloatArray, FloatArray]:
        """Times (n,), s, of all episodes one after the other, and states (n, count)."""
        parquet = load("pyarrow.parquet", self.extra)
        files = sorted((path / "data").rglob("*.parquet"))
        if not files:
            raise ForeignFileError("no data/**/*.parquet", "at least one", file=path)
        times, states, rows = list[FloatArray](), list[FloatArray](), 0
        most_rows = 5_000_000
        # Between the clocks of two episodes, s: nothing is known of the arm in between.
        between = 1e4
        for file in files:
            note_input(file)
            # A link must not lead out of the dataset.
            if not file.resolve().is_relative_to(path.resolve()):
                raise ForeignFileError("a link to a place outside the folder", "a file", file=file)
            try:
                rows += parquet.read_metadata(file).num_rows
                table = None if rows > most_rows else parquet.read_table(file, columns=[*_COLUMNS])
                columns = [] if table is None else [table[name].to_pylist() for name in _COLUMNS]
            # Damaged files make Arrow raise errors of many kinds, none of them its own.
            except Exception as problem:  # noqa: BLE001
                reason = " ".join(f"{type(problem).__name__}: {problem}".split())[:120]
                description = f"a file that cannot be read ({reason})"
                expected = f"Parquet with {listed(_COLUMNS)}"
                raise ForeignFileError(description, expected, file=file) from None
            if not columns:
                reason = f"more than {most_rows} rows"
                raise ForeignFileError(reason, "a smaller dataset", file=path)
            state, stamp, episode = (
                _array(file, *column) for column in zip(_COLUMNS, columns, strict=True)
            )
            if state.shape != (len(state), count) or stamp.ndim != 1 or episode.ndim != 1:
                reason = f"states of shape {state.shape}"
                raise ForeignFileError(reason, f"{count} numbers in each row", file=file)
            times.append(stamp + between * episode)
            states.append(state)
        return np.concatenate(times), np.concatenate(states)


def _array(file: Path, name: str, values: Sequence[Any]) -> FloatArray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if not len(array) or not np.isfinite(array).all():
        problem = "rows where it is missing or not a number"
        raise ForeignFileError(problem, "finite numbers in every row", file=file, where=name)
    return array


def _motors(path: Path, info: Any) -> list[str]:
    """Names of the states' motors in ``info.json``, without what LeRobot puts behind them."""
    names = info
    for key in ("features", _STATE, "names"):
        names = names.get(key) if isinstance(names, dict) else None
    if isinstance(names, dict) and len(names) == 1:
        names = next(iter(names.values()))
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        where = f"features: {_STATE}: names"
        raise ForeignFileError(
            "no list of motors", "the motors of the states", file=path, where=where
        )
    return [name.removesuffix(".pos") for name in names]
