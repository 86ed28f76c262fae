"""The raw stream: a Parquet file in the end, recoverable until then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from device_stand_in import Script

from suta_calib.acquisition.raw import RawRecorder
from suta_calib.errors import InputError, OutputError

parquet = pytest.importorskip("pyarrow.parquet")
JOINTS = ("a", "b", "c")
READINGS = Script(np.zeros(3)).rest(7.0).readings()


def test_every_reading_is_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "raw.parquet"
    with RawRecorder(file, JOINTS) as recorder:
        for first in range(0, len(READINGS), 50):
            recorder.write(READINGS[first : first + 50])
        assert not file.exists()
    table = parquet.read_table(file)
    assert table["sequence"].to_pylist() == [r.sequence for r in READINGS]
    assert table["b"].to_pylist() == [r.angles[1] for r in READINGS]
    assert [p.name for p in tmp_path.iterdir()] == ["raw.parquet"]


@pytest.mark.parametrize("lost", [0, 300])
def test_who_is_killed_finds_it_again(tmp_path: Path, lost: int) -> None:
    file, part = tmp_path / "raw.parquet", tmp_path / "raw.parquet.part"
    with RawRecorder(file, JOINTS) as killed:
        killed.write(READINGS)
        killed.write(READINGS)
        left = part.read_bytes()
    file.unlink()
    part.write_bytes(left[: len(left) - lost])  # in the middle of a write
    said: list[str] = []
    with RawRecorder(file, JOINTS, said.append) as recorder:
        recorder.write(READINGS[:10])
    assert parquet.read_table(file).num_rows == 10
    recovered = parquet.read_table(tmp_path / "raw-recovered-1.parquet")
    whole = [r.sequence for r in READINGS]
    assert recovered["sequence"].to_pylist() == (whole if lost else whole + whole)
    assert said == [
        f"{len(recovered)} readings of an interrupted run were saved in "
        f"{tmp_path / 'raw-recovered-1.parquet'}"
    ]
    assert not part.exists()


def test_what_is_no_recording_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "raw.parquet.part").write_text("somebody's notes", encoding="utf-8")
    with pytest.raises(InputError, match="not a recording"):
        RawRecorder(tmp_path / "raw.parquet", JOINTS)
    assert (tmp_path / "raw.parquet.part").read_text(encoding="utf-8") == "somebody's notes"


def test_no_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="not written"):
        RawRecorder(tmp_path / "none" / "raw.parquet", JOINTS)
