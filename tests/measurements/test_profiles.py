"""The file of a line scanner's profiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from suta_calib.errors import SamplesError
from suta_calib.measurements.profiles import profiles_of, read_profiles, write_profiles


def test_profiles_are_read_in_m_or_mm_without_what_was_not_seen(tmp_path: Path) -> None:
    path = tmp_path / "profiles.csv"
    path.write_text("scan,x_mm,z_mm\na,1,2\na,nan,3\nb,0,0\nb,4,5\na,6,\n")
    found = read_profiles(path)
    assert found.scan.tolist() == ["a", "b"]
    np.testing.assert_allclose(found.point, [[1e-3, 2e-3], [4e-3, 5e-3]])
    path.write_text("scan,x,z\nb,0.001,0.002\na,0.004,0.005\nb,0.003,0.004\n")
    by_scan = read_profiles(path).by_scan()
    assert [*by_scan] == ["b", "a"]
    np.testing.assert_allclose(by_scan["b"], [[1e-3, 2e-3], [3e-3, 4e-3]])


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    profiles = profiles_of(["1", "1", "2"], [[0.01, 0.2], [0.02, 0.3], [0.03, 0.4]])
    write_profiles(tmp_path / "profiles.csv", profiles)
    again = read_profiles(tmp_path / "profiles.csv")
    assert again.scan.tolist() == ["1", "1", "2"]
    np.testing.assert_allclose(again.point, profiles.point, atol=1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scan,x,z_mm\na,1,2\n", "found the columns x, z_mm; expected x and z in m"),
        ("scan,x,y\na,1,2\n", "found the columns x; expected"),
        ("scan,x,z\na,12,150\n", "are the numbers in mm"),
        ("scan,x,z\na,nan,0.1\n", "found no point"),
        ("scan,x,z\na,0.1,far\n", "a finite number"),
        ("x,z\n0.1,0.2\n", "name of the profile"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "profiles.csv"
    path.write_text(text)
    with pytest.raises(SamplesError, match=message):
        read_profiles(path)


def test_arrays_must_fit_together() -> None:
    with pytest.raises(SamplesError, match="shapes"):
        profiles_of(["a"], [[0.1, 0.2, 0.3]])
