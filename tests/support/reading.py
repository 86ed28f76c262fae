"""What the tests of the readers share."""

from __future__ import annotations

from pathlib import Path

import pytest

from suta_calib.errors import SamplesError
from suta_calib.measurements import JointRange, SampleColumns, read_samples

REVOLUTE = JointRange("j1", "rad", -3.0, 3.0)
PRISMATIC = JointRange("lift", "m", 0.0, 0.4)
TOUCHED = SampleColumns(labels=("point",))
TRACKED = SampleColumns(position=True, orientation="optional")
SEEN = SampleColumns(position=True, orientation="required")


def write(folder: Path, text: str | bytes, name: str = "a.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refusal(
    folder: Path, text: str | bytes, columns: SampleColumns, *joints: JointRange
) -> SamplesError:
    """The error that a samples file raises; it always names the file."""
    path = write(folder, text)
    with pytest.raises(SamplesError) as caught:
        read_samples([path], joints or (REVOLUTE,), columns)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    return caught.value
