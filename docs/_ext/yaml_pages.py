"""The page of every YAML file, from the keys that its reader checks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from markdown_pieces import anchor, table
from repository_pages import ROOT

from suta_calib.analysis.planning.candidates import KEYS as CANDIDATE_KEYS
from suta_calib.certificate.details import DETAILS_KEYS, EXAMPLE
from suta_calib.device.device_file import DEVICE_KEYS
from suta_calib.job.acceptance import ACCEPTANCE_KEYS
from suta_calib.job.schema import JOB_KEYS
from suta_calib.measurements.artefact import ARTEFACT_KEYS
from suta_calib.measurements.board import BOARD_KEYS
from suta_calib.measurements.camera import CAMERA_KEYS
from suta_calib.measurements.fields import Fields, fields_of
from suta_calib.registry import shipped
from suta_calib.simulation.schema import SIMULATION_KEYS, set_keys
from suta_calib.terms import KINDS
from suta_calib.tracking.recalibration import RecalibrationSpec


@dataclass(frozen=True)
class FileFormat:
    """One YAML file that the package reads.

    Attributes:
        name: of the file.
        about: what it is for.
        keys: by title, its keys; one title only where there is one sort of it.
        example: a shipped file, from the repository's root, or a text.
    """

    name: str
    about: str
    keys: dict[str, Fields]
    example: str


DEVICE_EXAMPLE = """\
port: /dev/ttyACM0
baudrate: 921600
format: frames
joints: [{name: joint_1, sign: 1}, {name: joint_2, sign: -1}]
"""
CANDIDATES_EXAMPLE = """\
repeats: 3
grids:
  G: {x_mm: [450, 500], y_mm: [-50, 50], z_mm: 0, yaw_deg: [0, 90]}
points:
  F1: {position_mm: [460, 10, 150], directions: 20, cone_deg: 60}
"""
POINTS_EXAMPLE = """\
points:
  dock: {position_mm: [250, 0, 40], sigma_mm: 1}
drift: {zeros_deg: 0.1, hours: 2}
"""
FILES = (
    FileFormat(
        "calibration.yaml",
        "One calibration: the arm, its unknown parameters, observations and validation data. "
        "Paths are relative to the file.",
        {"": JOB_KEYS},
        "data/suta/calibration_full.yaml",
    ),
    FileFormat(
        "artefact.yaml",
        "A rigid body with landmarks at certified positions.",
        {"": ARTEFACT_KEYS},
        "examples/panda_sockets/artefact.yaml",
    ),
    FileFormat(
        "board.yaml",
        "A printed board for cameras.",
        {f"type: {name}": keys for name, keys in BOARD_KEYS.items()},
        "data/workcell/board.yaml",
    ),
    FileFormat(
        "camera.yaml",
        "A calibrated camera, as ROS and OpenCV write it. Other keys are ignored.",
        {"": CAMERA_KEYS},
        "examples/camera_on_arm/camera.yaml",
    ),
    FileFormat(
        "device.yaml",
        "A connected arm: its port, format and joints.",
        {"": DEVICE_KEYS},
        DEVICE_EXAMPLE,
    ),
    FileFormat(
        "simulation.yaml",
        "Measurements to simulate: the nominal arm, the errors of the true one, the noise, and "
        "the sets of measurements.",
        {"": SIMULATION_KEYS}
        | {f"a set of kind {name}": set_keys(kind) for name, kind in shipped(KINDS).items()},
        "data/plane/simulation.yaml",
    ),
    FileFormat(
        "iso10360.yaml",
        "An acceptance test by ISO 10360-12. A calibration.yaml may be used instead, "
        "without limits.",
        {"": ACCEPTANCE_KEYS},
        "data/accuracy/iso10360.yaml",
    ),
    FileFormat(
        "certificate.yaml",
        "What a certificate says beside the results, for `suta-calib certificate --details`.",
        {"": DETAILS_KEYS},
        EXAMPLE,
    ),
    FileFormat(
        "candidates.yaml",
        "Candidates for the next measurements, for `suta-calib plan --candidates`.",
        {"": CANDIDATE_KEYS},
        CANDIDATES_EXAMPLE,
    ),
    FileFormat(
        "points.yaml",
        "Points that do not move, and what may drift, for `suta-calib track --recalibrate`.",
        {"": fields_of(RecalibrationSpec)},
        POINTS_EXAMPLE,
    ),
)


def files_page() -> Iterator[str]:
    """Every YAML file: its keys, and an example."""
    yield "# YAML files\n\n"
    yield (
        "This page is made from the code of the readers. A key that is not listed is refused, with "
        "its line; **bold** keys are required. Lengths are in mm and angles in degrees, as the "
        "names of the keys show.\n\n"
    )
    for file in FILES:
        yield f"({anchor(file.name)})=\n## {file.name}\n\n{file.about}\n\n"
        shown: set[int] = set()
        for title, keys in file.keys.items():
            if title:
                yield f"### `{title}`\n\n"
            yield from key_tables(keys, shown)
        yield f"Example:\n\n```yaml\n{example(file.example)}```\n\n"


def example(text: str) -> str:
    """A shipped file's content, or the text itself."""
    return text if "\n" in text else (ROOT / text).read_text(encoding="utf-8")


def key_tables(keys: Fields, shown: set[int], path: str = "") -> Iterator[str]:
    """A table of these keys, then one for each mapping below them that is not shown yet.

    Args:
        keys: of one mapping.
        shown: identities of the mappings that have been shown; added to.
        path: where these stand; empty for the whole file.
    """
    rows = [
        (f"**`{key.name}`**" if key.required else f"`{key.name}`", key.value.takes, key.about)
        for key in keys
    ]
    yield table(("key", "value", ""), rows)
    below = [
        (f"{path}.{key.name}".lstrip("."), key.value.inside) for key in keys if key.value.inside
    ]
    first = {id(inside): inside for _, inside in below if id(inside) not in shown}
    shown.update(first)
    for inside in first.values():
        names = [name for name, each in below if each is inside]
        yield f"Under {', '.join(f'`{name}`' for name in names)}:\n\n"
        yield from key_tables(inside, shown, names[0])
