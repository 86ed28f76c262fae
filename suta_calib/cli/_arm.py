"""An arm given by options rather than by a job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from suta_calib.model.arm import ArmModel


def optional_arm(
    urdf: Path | None, tip: str | None, base: str | None, what: str
) -> ArmModel | None:
    """The arm of ``--urdf``, ``--tip`` and ``--base``; None where none is given.

    Args:
        urdf: the arm's file.
        tip: link or frame at the end of the chain.
        base: link at its start; the root where not given.
        what: what the tip did, for the message that it is missing.

    Raises:
        UsageError: a frame without an arm, or an arm without a tip.
    """
    if urdf is None:
        if tip or base:
            raise click.UsageError("--tip and --base name frames of an arm: give it with --urdf")
        return None
    if tip is None:
        raise click.UsageError(f"--urdf needs --tip: the link or frame that {what}")
    from suta_calib.model.arm import ArmModel

    return ArmModel.from_urdf(urdf, tip, base)
