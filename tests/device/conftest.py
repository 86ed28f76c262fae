"""A device at the other end of a wire."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from device_streams import PtyDevice


@pytest.fixture
def arm(tmp_path: Path) -> Iterator[PtyDevice]:
    """A device on a pty."""
    with PtyDevice(tmp_path / "arm") as plugged:
        yield plugged
