"""URDFs that are generated: a ``.xacro`` file stands for what xacro makes of it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from suta_calib.atomic import note_input
from suta_calib.errors import SutaCalibError, UrdfError
from suta_calib.extras import load

_LONGEST: Final = 200


def is_xacro(path: Path) -> bool:
    """Whether a file is to be run through xacro, as its name says."""
    return path.suffix.lower() == ".xacro"


def expanded(path: Path) -> bytes:
    """The URDF that a xacro file makes, with its default arguments.

    ``$(find …)`` and ``package://`` are looked for in folders above the file, without ROS.

    Raises:
        UrdfError: missing, or refused by xacro, with what it said.
        MissingExtraError: xacrodoc is not installed.
    """
    if not path.is_file():
        found = "a directory" if path.is_dir() else "no such file"
        raise UrdfError(found, "a .xacro file", file=path)
    note_input(path)
    xacrodoc = load("xacrodoc", "formats")
    try:
        text = xacrodoc.XacroDoc.from_file(str(path)).to_urdf_string()
    except SutaCalibError:
        raise
    # Whatever stands in the file's expressions may raise whatever it likes.
    except Exception as problem:  # noqa: BLE001
        said = " ".join(f"{type(problem).__name__}: {problem}".split())[:_LONGEST]
        raise UrdfError(
            f"what xacro refuses ({said})", "a file that xacro expands by itself", file=path
        ) from None
    return str(text).encode()


@contextlib.contextmanager
def plain_urdf(path: Path) -> Iterator[Path]:
    """A URDF file for readers that know no xacro: the file itself, or what xacro makes of it.

    Raises:
        UrdfError, MissingExtraError: as `expanded`.
    """
    if not is_xacro(path):
        yield path
        return
    # Few URDFs are generated.
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{path.stem}.urdf"
        file.write_bytes(expanded(path))
        yield file
