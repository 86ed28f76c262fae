"""Positions in programs of robot controllers: joints in rad, poses in m, each with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from foreign import check, imported
from foreign_samples import JOINTS, PROGRAMS, P, R

from suta_calib.errors import InputError


@pytest.mark.parametrize("form", PROGRAMS)
def test_poses(form: str, tmp_path: Path) -> None:
    found = imported(PROGRAMS[form](tmp_path).path, what="poses")
    assert found.form == form
    check(found, tmp_path / "o.csv", R, P)


@pytest.mark.parametrize("form", PROGRAMS)
def test_joints(form: str, tmp_path: Path) -> None:
    """What stands in a comment is no position; a row says in which line it stands."""
    path = PROGRAMS[form](tmp_path).path
    found = imported(path, what="joints", joint_names="a,b,c,d,e,f")
    angles = np.stack([found.columns[name] for name in "abcdef"], axis=1)
    np.testing.assert_allclose(angles, JOINTS, atol=1e-12)
    assert found.columns["line"].tolist() == list(range(3, 19, 2))
    assert "joint_6" in imported(path, what="joints").columns


@pytest.mark.parametrize("form", PROGRAMS)
def test_which_positions_is_asked(form: str, tmp_path: Path) -> None:
    path = PROGRAMS[form](tmp_path).path
    with pytest.raises(InputError, match=r"8 joints and 8 poses; .*--what joints"):
        imported(path)
    with pytest.raises(InputError, match=r"--joint-names: found 2 names; expected 6"):
        imported(path, what="joints", joint_names="a,b")
    path.write_text("MODULE\nDEF a()\nmovej(here)\n")
    with pytest.raises(InputError, match="found no positions; expected positions as"):
        imported(path, form)
