"""A tool relative to a reference body: two sets of columns, or two files of the same rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported, poses, transforms, written
from scipy.spatial.transform import Rotation

from suta_calib.arrays import FloatArray
from suta_calib.errors import InputError

R, P = poses()
T = transforms(R, P)


def test_a_tool_relative_to_a_reference_body(tmp_path: Path) -> None:
    """T_reference_tool of two sets of columns, as navigation laboratories record them."""
    reference = transforms(*poses(seed=3))
    seen = reference @ T
    quaternion = Rotation.from_matrix(seen[:, :3, :3]).as_quat()
    other = Rotation.from_matrix(reference[:, :3, :3]).as_quat()
    header = ",".join(
        f"{body}_{n}" for body in ("tool", "ref") for n in ("x", "y", "z", "qx", "qy", "qz", "qw")
    )
    rows = np.hstack([seen[:, :3, 3], quaternion, reference[:, :3, 3], other])
    path = written(tmp_path / "t.csv", rows, header=header)
    for names in ({"body": "tool_", "reference": "ref_"}, {"body": "Tool", "reference": "REF"}):
        check(imported(path, **names), tmp_path / "o.csv", R, P)
    with pytest.raises(InputError, match=r"2 bodies or markers: tool, ref.*--body"):
        imported(path)


def test_a_tool_relative_to_a_reference_body_in_another_file(tmp_path: Path) -> None:
    """Rows correspond; one in which either was not seen is left out."""
    reference = transforms(*poses(seed=3))
    tool = written(tmp_path / "tool.txt", (reference @ T).reshape(-1, 16))
    other = written(tmp_path / "reference.txt", reference.reshape(-1, 16))
    lines = other.read_text().splitlines()
    lines[4] = ",".join(["MISSING"] * 16)
    other.write_text("\n".join(lines) + "\n")
    found = imported(tool, reference=str(other))
    kept = np.delete(np.arange(len(P)), 4)
    assert found.dropped == 1
    check(found, tmp_path / "o.csv", R[kept], P[kept])
    other.write_text("\n".join(lines[:-1]) + "\n")
    with pytest.raises(InputError, match=r"reference.txt: found 11 rows; expected 12 rows, as in"):
        imported(tool, reference=str(other))


def test_files_whose_rows_were_taken_at_other_times_are_refused(tmp_path: Path) -> None:
    """Clocks may have begun at other times, but a row that only one file has shifts the rest."""
    reference, time = transforms(*poses(seed=3)), 0.1 * np.arange(len(P))
    header = "time," + ",".join(f"r{i}{j}" for i in range(3) for j in range(4))

    def recorded(name: str, T: FloatArray, at: FloatArray) -> Path:
        return written(tmp_path / name, np.hstack([at[:, None], T.reshape(-1, 12)]), header=header)

    tool = recorded("tool.csv", (reference @ T)[:, :3], time)
    same = recorded("same.csv", reference[:, :3], 7 + time + 1e-3 * np.sin(time))
    found = imported(tool, reference=str(same))
    check(found, tmp_path / "o.csv", R, P)
    later = recorded("later.csv", reference[:, :3], time + 0.1 * (time > 0.45))
    with pytest.raises(
        InputError, match=r"later.csv:7: found a row with another time; expected the"
    ):
        imported(tool, reference=str(later))


def test_a_reference_that_is_the_tool_itself_is_refused(tmp_path: Path) -> None:
    """Every pose would be that of no motion."""
    path = written(tmp_path / "tool.txt", T.reshape(-1, 16))
    with pytest.raises(
        InputError, match=r"--reference: found .*tool.txt, which is the file itself"
    ):
        imported(path, reference=str(path))
    header = ",".join(f"tool_{n}" for n in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    rows = np.hstack([P, Rotation.from_matrix(R).as_quat()])
    one = written(tmp_path / "one.csv", rows, header=header)
    with pytest.raises(InputError, match="the body itself"):
        imported(one, body="tool_", reference="tool_")
