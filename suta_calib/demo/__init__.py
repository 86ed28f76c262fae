"""Examples that come with the package: their files, and where an installed package keeps them.

The files stand once in the repository, under ``data``, ``examples`` and ``urdf``. The wheel has
those that `Example.files` names at the same paths below ``FILES``
(``[tool.hatch.build.targets.wheel]`` in ``pyproject.toml``).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suta_calib.atomic import exchange_files
from suta_calib.errors import OutputError

_HERE: Final = Path(__file__).parent
FILES: Final = "files"


@dataclass(frozen=True)
class Example:
    """One thing to try.

    Attributes:
        title: what was measured, and whether it was measured or simulated.
        command: the words of the command line behind the program's name; the last one is the file
            that is read, below the folder of the demo.
        files: patterns of what it needs, below the root of the repository.
    """

    title: str
    command: tuple[str, ...]
    files: tuple[str, ...]

    @property
    def file(self) -> str:
        """What the command reads."""
        return self.command[-1]


EXAMPLES: Final = (
    Example(
        "a measured UR5: its reflector was seen by a laser tracker in 1,020 poses",
        ("calibrate", "examples/ur5_laser_tracker/calibration.yaml"),
        (
            "examples/ur5_laser_tracker/*.*",
            "examples/ur5_laser_tracker/LICENSE",
            "examples/ur5_laser_tracker/calibration/*.csv",
            "examples/ur5_laser_tracker/validation/*.csv",
        ),
    ),
    Example(
        "a simulated arm on a cable (SUTA): it touched an artefact",
        ("calibrate", "data/suta/calibration.yaml"),
        (
            "urdf/suta.urdf",
            "data/suta/*.*",
            "data/suta/[cfv]*/*.csv",
        ),
    ),
    Example(
        "a simulated camera on a hand: 30 poses, two of them wrong",
        ("hand-eye", "--out", "data/poses/results", "data/poses/hand_eye.csv"),
        ("data/poses/README.md", "data/poses/*.csv"),
    ),
    Example(
        "a simulated arm and its camera: 28 rendered pictures of a board",
        ("calibrate", "data/workcell/calibration.yaml"),
        ("data/workcell/*.[!p]*", "data/workcell/pictures/0[0-5].jpg"),
    ),
)
# Needs the extra `vision`.
PICTURES: Final = (
    *("detect", "data/workcell/pictures", "--board", "data/workcell/board.yaml"),
    *("--out", "corners.csv"),
)


def root() -> Path:
    """The folder that has the examples' files: of the package, or of the repository around it."""
    installed = _HERE / FILES
    return installed if installed.is_dir() else _HERE.parents[1]


def write_examples(folder: Path, examples: Iterable[Example] = EXAMPLES) -> None:
    """Write the examples' files into a folder, which is made where it is not there.

    Raises:
        OutputError: a file of the same name and another content is there, which may be the work of
            the user, or the folder cannot be written.
    """
    origin = root()
    contents: dict[Path, dict[str, bytes]] = {}
    for pattern in (pattern for example in examples for pattern in example.files):
        for path in sorted(origin.glob(pattern)):
            place = folder / path.relative_to(origin)
            contents.setdefault(place.parent, {})[place.name] = path.read_bytes()
    for parent, files in contents.items():
        for name, content in files.items():
            if (place := parent / name).exists() and place.read_bytes() != content:
                raise OutputError(
                    f"{place}: found a file that was changed since the demo wrote it; expected "
                    "that of the demo or nothing; choose another folder with --out"
                )
    for parent, files in contents.items():
        try:
            parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{parent}: not made: {error.strerror or error}") from error
        exchange_files(parent, files)
