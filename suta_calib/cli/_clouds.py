"""What commands that search clouds of points share."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from suta_calib.atomic import check_outputs
from suta_calib.cli._options import PATH, length_unit, option
from suta_calib.measurements import read_camera
from suta_calib.units import from_mm
from suta_calib.vision.clouds import CloudReader, find_clouds

Command = TypeVar("Command", bound=Callable[..., Any])


def cloud_options(command: Command) -> Command:
    """Options that say how clouds are read."""
    for decorator in (
        option(
            "--range NEAR FAR",
            "Nearest and farthest point that counts, in mm; default: all.",
            float,
            nargs=2,
            name="reach",
        ),
        option(
            "--camera CAMERA.yaml",
            "File of the depth camera: CLOUDS may then be pictures of depth (16-bit PNG or TIFF, "
            "floating-point TIFF, NPY).",
            PATH,
        ),
        option(
            "--unit UNIT",
            "Unit of the clouds: m, mm, or how many m one step is; default: m, and mm for "
            "pictures of whole numbers.",
            length_unit,
        ),
    ):
        command = decorator(command)
    return command


def clouds_to_read(
    clouds: Sequence[Path],
    out: Path | None,
    *,
    unit: float | None,
    camera: Path | None,
    reach: tuple[float, float] | None,
) -> tuple[CloudReader, dict[str, Path]]:
    """How clouds are read, and their files by name; refused where a file cannot be written."""
    if reach is not None and not 0.0 <= reach[0] < reach[1]:
        raise click.UsageError("--range needs the nearest distance, then a larger one, in mm")
    near, far = (0.0, math.inf) if reach is None else reach
    intrinsics = None if camera is None else read_camera(camera)
    reader = CloudReader(unit, intrinsics, (from_mm(near), from_mm(far)))
    cloud_files = find_clouds(clouds, reader.suffixes)
    given = [*cloud_files.values()] if camera is None else [*cloud_files.values(), camera]
    check_outputs([out] if out else [], given)
    return reader, cloud_files
