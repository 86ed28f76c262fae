"""What is searched in clouds of points that a depth camera saw: files, and many of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.measurements import Camera
from suta_calib.measurements.cloud_files import SUFFIXES, Cloud, read_cloud
from suta_calib.threads import usable_cores
from suta_calib.vision import depth

Found = TypeVar("Found")


@dataclass(frozen=True, eq=False)
class CloudReader(Displayable):
    """How clouds are read: files of points, or pictures of depth with their camera.

    Attributes:
        unit: m of one unit of the files; by default m, and mm of pictures of whole numbers.
        camera: that took pictures of depth; None for files of points alone.
        reach: nearest and farthest point that counts, m.
    """

    unit: float | None = None
    camera: Camera | None = None
    reach: tuple[float, float] = (0.0, np.inf)

    @property
    def suffixes(self) -> frozenset[str]:
        """Of files that are read from a folder."""
        return SUFFIXES if self.camera is None else SUFFIXES | depth.SUFFIXES

    def __call__(self, path: Path) -> Cloud:
        """A cloud.

        Raises:
            InputError: as of `read_cloud` and `read_depth`; no point in reach.
        """
        pictured = path.suffix.lower() in depth.SUFFIXES
        cloud = (
            read_cloud(path, self.unit)
            if self.camera is None or not pictured
            else self._of_depth(path, self.camera)
        )
        near, far = self.reach
        away = np.linalg.norm(cloud.points, axis=1)
        inside = (away >= near) & (away <= far)
        if not inside.any():
            raise InputError(
                f"no point from {near:g} to {far:g} m away",
                "points in the range that was given",
                file=path,
                hint=f"they are {away.min():.3g} to {away.max():.3g} m away",
            )
        return Cloud(cloud.points[inside], cloud.dropped, int(np.sum(~inside)))

    def _of_depth(self, path: Path, camera: Camera) -> Cloud:
        depths = depth.read_depth(path, self.unit)
        depth.check_shape(depths, camera, path)
        rays = self._rays(depths.shape[0], depths.shape[1])
        points = np.nan_to_num(rays * depths[..., None], nan=0.0)
        return Cloud.of(points, 1.0, path, "check --unit")

    def _rays(self, height: int, width: int) -> FloatArray:
        """(height, width, 3) at unit depth; those of a smaller copy are where its pixels are."""
        if (height, width) not in self._known_rays:
            assert self.camera is not None
            scale = width / self.camera.width
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            aside = self.camera.undistort((pixels + 0.5) / scale - 0.5)
            self._known_rays[height, width] = np.dstack([aside, np.ones((height, width))])
        return self._known_rays[height, width]

    @cached_property
    def _known_rays(self) -> dict[tuple[int, int], FloatArray]:
        return {}


# Files of points in m.
POINT_FILES: Final = CloudReader()


def find_clouds(paths: Iterable[Path], suffixes: frozenset[str] = SUFFIXES) -> dict[str, Path]:
    """Clouds by the names of their files, of files and of folders, in order.

    Raises:
        InputError: no such file, no cloud in a folder, or two of one name.
    """
    clouds = dict[str, Path]()
    for path in paths:
        files = [path]
        if path.is_dir():
            files = sorted(f for f in path.iterdir() if f.suffix.lower() in suffixes)
            if not files:
                kinds = ", ".join(sorted(suffixes))
                raise InputError("a folder without clouds", f"files such as {kinds}", file=path)
        for file in files:
            if not file.is_file():
                raise InputError("no such file", "a cloud, or a folder of clouds", file=file)
            if clouds.setdefault(file.name, file) != file:
                raise InputError(
                    f"two clouds called {file.name}",
                    "each name once",
                    file=file,
                    hint="each cloud is known by its file's name: give the file another one",
                )
    return clouds


def searched(
    clouds: Mapping[str, Path],
    reader: CloudReader,
    search: Callable[[str, Cloud], Found],
    progress: Callable[[int, int], None] | None = None,
) -> list[Found]:
    """What is found in each of some clouds, by their names, in order; several at a time.

    Args:
        clouds: files by name.
        reader: how they are read.
        search: in a cloud of a name.
        progress: is told how many clouds are done, and of how many.

    Raises:
        InputError: a cloud cannot be read.
    """

    def of(name: str) -> Found:
        return search(name, reader(clouds[name]))

    answers = list[Found]()
    with ThreadPoolExecutor(usable_cores()) as pool:
        try:
            for done, result in enumerate(pool.map(of, clouds), 1):
                answers.append(result)
                if progress is not None:
                    progress(done, len(clouds))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return answers


def dropped_words(dropped: int, count: int) -> str:
    """How many of all points have no place, in a sentence; empty where there are few."""
    part = dropped / max(count, 1)
    # Of a hundred points one: any camera leaves out as many.
    few = 0.01
    return f" {part:.0%} of all points had no place (zero, or not finite)." if part >= few else ""
