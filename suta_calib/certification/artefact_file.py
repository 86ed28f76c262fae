"""The certified artefact as a file a calibration reads, with its story above it."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path

from suta_calib.certification.result import Certification
from suta_calib.measurements import write_text
from suta_calib.measurements.artefact import artefact_text

_WIDTH = 98


def write_certified(path: Path, found: Certification) -> None:
    """Write ``artefact.yaml`` with a header that says how it came about.

    Raises:
        OutputError: the file cannot be written; what was there is untouched.
    """
    header = "".join(
        f"{line}\n"
        for paragraph in _story(found)
        for line in textwrap.wrap(paragraph, _WIDTH, initial_indent="# ", subsequent_indent="# ")
    )
    write_text(path, f"{header}{artefact_text(found.artefact())}")


def _story(found: Certification) -> Iterator[str]:
    yield (
        f"Certified by suta-calib certify from {found.points} points of {found.path.name}. "
        f"One touched coordinate scatters by {1e6 * found.noise:.2f} µm (one standard deviation, "
        f"{noise_source(found)})."
    )
    yield (
        f"Frame: {frame_sentence(found)} A position is the centre of a pillar's top; "
        "rotation_rpy_deg is the seated tip's (z down, x from the back flat to the front one)."
    )
    yield (
        "sigma_mm is the largest of the three coordinates' standard deviations in this frame, by "
        "first-order propagation from every touch."
    )
    if found.wrong_touches:
        yield f"Touches not used, by line: {', '.join(map(str, found.wrong_touches))}."
    if found.damaged:
        yield (
            f"DAMAGED, OR TOUCHED WRONGLY: {', '.join(found.damaged)}. Do not calibrate with this "
            "file before that is settled."
        )


def noise_source(found: Certification) -> str:
    """Where the noise of a touch was taken from."""
    if found.freedom == float("inf"):
        return "as stated"
    return f"from the residuals of planes, {found.freedom:.0f} degrees of freedom"


def frame_sentence(found: Certification) -> str:
    """How the artefact's frame lies in the artefact."""
    towards = {
        "side plane": "x along the side plane, which lies on the side of -y",
        "farthest landmark": f"x by convention from {found.origin} to the farthest landmark",
    }[found.heading]
    if found.heading == "side plane" and found.turned:
        towards = f"x as in the drawing, {90 * found.turned}° from the side plane's direction"
    elif found.heading == "farthest landmark" and found.comparison is not None:
        towards = "x as in the drawing, by the landmark farthest from the origin"
    return (
        f"z is the ground's normal, z = 0 the ground, x = y = 0 at {found.origin}, and {towards}."
    )
