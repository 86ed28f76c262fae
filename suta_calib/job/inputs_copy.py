"""A copy of what a job was made of, which goes with its results.

``inputs.zip`` holds the job, its URDF and its measurements, laid out so that the job's relative
paths hold within it (absolute ones are made relative). With it a folder of results can be copied to
elsewhere and read there, also when the job's own folder is gone or was changed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from suta_calib.errors import InputError
from suta_calib.measurements.files import is_empty_folder

NAME: Final = "inputs.zip"
_CONTENTS: Final = "inputs.json"
# Of all files together, as they are on the disk: beyond it the largest are left out. Samples of
# 100,000 rows take 10 MB.
MOST_BYTES: Final = 32 << 20
_TABLES: Final = (".csv", ".parquet")


def packed(job: Path, files: Iterable[Path], most: int = MOST_BYTES) -> bytes:
    """The copy of a job and of what was read for it as a ZIP file.

    What does not fit into ``most`` bytes is named in the copy and left out, the largest first.
    """
    job, files = _absolute(job), [_absolute(path) for path in files]
    paths = {path for path in files if path.is_file()}
    # Of a folder in which nothing is yet the job needs to know that it is there.
    folders = sorted(path for path in files if path.is_dir())
    paths |= {up / "package.xml" for path in paths for up in path.parents if _is_package(up)}
    root = Path(os.path.commonpath([job.parent, *folders, *(path.parent for path in paths)]))
    text = job.read_bytes()
    contents = {job: _with_relative_paths(text, job.parent)}
    left_out, room = dict[str, int](), most - len(text)
    # What every reader needs goes first: the arm and what is small; then tables of measurements.
    ranked = {
        path: (path.suffix.lower() in _TABLES, path.stat().st_size, path) for path in paths - {job}
    }
    for path in sorted(ranked, key=ranked.__getitem__):
        size = path.stat().st_size
        if size > room:
            left_out[path.relative_to(root).as_posix()] = size
            continue
        room -= size
        contents[path] = path.read_bytes()
    table_of_contents = {
        "job": job.relative_to(root).as_posix(),
        "folder": str(root),
        "sha256": {
            path.relative_to(root).as_posix(): hashlib.sha256(
                text if path == job else data
            ).hexdigest()
            for path, data in contents.items()
        },
        "left_out": left_out,
        "empty": [path.relative_to(root).as_posix() for path in folders],
    }
    entries = {path.relative_to(root).as_posix(): data for path, data in contents.items()}
    stream = io.BytesIO()
    # One file has one content, whenever it is written: the time is not the file's.
    time = (1980, 1, 1, 0, 0, 0)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for name, data in {
            _CONTENTS: json.dumps(table_of_contents, indent=1).encode(),
            **entries,
        }.items():
            entry = zipfile.ZipInfo(name, time)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, data)
    return stream.getvalue()


@dataclass(frozen=True)
class InputsCopy:
    """What a copy holds.

    Attributes:
        path: the ZIP file.
        job: name of the job in it.
        folder: where its files were when the job ran.
        sha256: of each file, as it was there, by its name in the copy.
        left_out: sizes of files that did not fit, bytes, by name.
        empty: folders in which nothing was.
    """

    path: Path
    job: str
    folder: Path
    sha256: dict[str, str]
    left_out: dict[str, int]
    empty: tuple[str, ...] = ()

    @classmethod
    def read(cls, path: Path) -> InputsCopy:
        """What is in a copy.

        Raises:
            InputError: it is no such file, or holds more than one may.
        """
        try:
            with zipfile.ZipFile(path) as archive:
                if sum(entry.file_size for entry in archive.infolist()) > 2 * MOST_BYTES:
                    raise _damaged(path, f"more than {2 * MOST_BYTES >> 20} MB")
                table_of_contents: Any = json.loads(archive.read(_CONTENTS))
            copy = cls(
                path,
                str(table_of_contents["job"]),
                Path(str(table_of_contents["folder"])),
                {str(name): str(value) for name, value in table_of_contents["sha256"].items()},
                {str(name): int(value) for name, value in table_of_contents["left_out"].items()},
                tuple(map(str, table_of_contents.get("empty", ()))),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile):
            raise _damaged(path, "another or a damaged file") from None
        named = (*copy.sha256, *copy.empty)
        if copy.job not in copy.sha256 or not all(map(_stays_inside, named)):
            raise _damaged(path, "names of files that do not belong to it")
        return copy

    def is_at(self, folder: Path) -> bool:
        """Whether the files still stand in a folder, each as it was."""
        if any(not (folder / name).is_file() for name in (*self.sha256, *self.left_out)):
            return False
        if any(not is_empty_folder(folder / name) for name in self.empty):
            return False
        return all(
            hashlib.sha256((folder / name).read_bytes()).hexdigest() == value
            for name, value in self.sha256.items()
        )

    def extract(self, folder: Path) -> Path:
        """Write the files into a folder; gives the job's."""
        try:
            for name in self.empty:
                (folder / name).mkdir(parents=True, exist_ok=True)
            with zipfile.ZipFile(self.path) as archive:
                for name in self.sha256:
                    place = folder / name
                    place.parent.mkdir(parents=True, exist_ok=True)
                    place.write_bytes(archive.read(name))
        except (KeyError, zipfile.BadZipFile, OSError):
            raise _damaged(self.path, "a file that cannot be unpacked") from None
        return folder / self.job


def _damaged(path: Path, content: str) -> InputError:
    expected = "the copy of the job's files as calibrate wrote it"
    return InputError(content, expected, file=path, hint="calibrate again")


def _absolute(path: Path) -> Path:
    """As it was named, links kept, but where ``..`` behind a link means another folder."""
    plain = Path(os.path.abspath(path))  # noqa: PTH100 (resolve() would follow links)
    return plain if plain.exists() and plain.samefile(path) else path.resolve()


def _is_package(folder: Path) -> bool:
    """Of a description that is a ROS package: xacro finds its files by it."""
    return (folder / "package.xml").is_file()


def _with_relative_paths(text: bytes, folder: Path) -> bytes:
    """A job in which no path is absolute, character for character the same otherwise."""
    content = text.decode("utf-8-sig")
    for scalar in reversed(list(_scalars(yaml.compose(content, Loader=yaml.CSafeLoader)))):
        if Path(scalar.value).is_absolute():
            relative = json.dumps(Path(os.path.relpath(scalar.value, folder)).as_posix())
            start, end = scalar.start_mark.index, scalar.end_mark.index
            content = content[:start] + relative + content[end:]
    return content.encode()


def _scalars(node: yaml.Node | None) -> Iterable[yaml.ScalarNode]:
    """Values of a document in the order of its text; keys are no values."""
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            yield from _scalars(item)
    elif isinstance(node, yaml.MappingNode):
        for _, value in node.value:
            yield from _scalars(value)


def _stays_inside(name: str) -> bool:
    path = Path(name)
    return not path.is_absolute() and ".." not in path.parts and bool(path.parts)
