"""What the commands on poses answer."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from cli_job import cli

Capture = pytest.CaptureFixture[str]
XYZ = ("x", "y", "z")


def answer(capsys: Capture, *arguments: object, code: int = 0) -> dict[str, Any]:
    """What a command prints with --json: one object, and nothing on stderr."""
    assert cli(*arguments, "--json") == code
    out, err = capsys.readouterr()
    assert err == ""
    found = json.loads(out)
    assert isinstance(found, dict)
    return found


def within(found: Any, true: Any, std: Any) -> None:
    """Estimates within five standard deviations of the truth, and these of a sensible size."""
    found, true, std = np.asarray(found), np.asarray(true), np.asarray(std)
    assert (std > 0).all()
    assert (np.abs(found - true) < 5 * std).all()
