"""The arm that is emulated."""

from __future__ import annotations

from pathlib import Path

import pytest

from suta_calib.model.arm import ArmModel


@pytest.fixture(scope="package")
def arm(suta_urdf: Path) -> ArmModel:
    return ArmModel.from_urdf(suta_urdf, "tip")
