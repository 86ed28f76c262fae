"""Planes in clouds of points that a depth camera or a 3-D scanner saw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.cloud_plane import CloudPlane, plane_in
from suta_calib.measurements.cloud_files import Cloud
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.vision.clouds import POINT_FILES, CloudReader, dropped_words, searched
from suta_calib.words import listed


@dataclass(frozen=True, eq=False)
class CloudWithPlane(Displayable):
    """Result for one cloud.

    Attributes:
        image: what the cloud is called.
        count, dropped: points of the cloud, and those of it without a place.
        plane: where it is; None where none was found.
        reason: why not; empty where it was.
    """

    image: str
    count: int
    dropped: int
    plane: CloudPlane | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class PlaneSearch(Displayable):
    """The plane of one name in clouds.

    Attributes:
        name: what it is called.
        clouds: every cloud that was searched, in order.
        points: three of each plane that was found, which stand for it (`CloudPlane.marks`).
        noise: a and b of the noise ``a + b r²`` along the rays, at the distance r, m and 1/m.
        assessment: how far to trust it.
    """

    name: str
    clouds: Sequence[CloudWithPlane]
    points: SeenPoints
    noise: tuple[float, float]
    assessment: Assessment

    @property
    def found(self) -> list[tuple[str, CloudPlane]]:
        """Clouds with a plane, by name."""
        return [(cloud.image, cloud.plane) for cloud in self.clouds if cloud.plane is not None]


def find_planes(
    clouds: Mapping[str, Path],
    name: str,
    reader: CloudReader = POINT_FILES,
    progress: Callable[[int, int], None] | None = None,
) -> PlaneSearch:
    """Find the largest plane in each of some clouds.

    Args:
        clouds: files by name.
        name: of the plane.
        reader: how they are read.
        progress: is told how many clouds are done, and of how many.

    Raises:
        InputError: a cloud cannot be read, or no plane is in any of them.
    """

    def search(image: str, cloud: Cloud) -> CloudWithPlane:
        plane = plane_in(cloud.points)
        reason = "" if plane else "no plane, or one of few points"
        return CloudWithPlane(image, cloud.count, cloud.dropped, plane, reason)

    results = searched(clouds, reader, search, progress)
    planes = [(entry.image, entry.plane) for entry in results if entry.plane is not None]
    if not planes:
        raise SamplesError(
            "no plane in any cloud",
            "a plane that is a tenth of a cloud or more",
            file=next(iter(clouds.values())),
            hint="a cloud must be in the sensor's own frame, with the sensor at the origin; cut "
            "off what is nearer or farther with --range",
        )
    points = SeenPoints(
        np.repeat([image for image, _ in planes], 3),
        np.repeat([name], 3 * len(planes)),
        np.concatenate([plane.marks for _, plane in planes]),
        np.repeat([[plane.sigma] * 3 for _, plane in planes], 3, axis=0),
    )
    noise = np.median([plane.noise for _, plane in planes], axis=0)
    count, dropped = (
        sum(getattr(entry, part) for entry in results) for part in ("count", "dropped")
    )
    sentence = f"Plane {name} found in {len(planes)} of {len(results)} clouds."
    assessment = Assessment.of(sentence + dropped_words(dropped, count), care=_notes(results))
    return PlaneSearch(name, results, points, (float(noise[0]), float(noise[1])), assessment)


def _notes(results: Sequence[CloudWithPlane]) -> list[str]:
    """What must be known: clouds without a plane, or with two that are alike."""
    notes = list[str]()
    most_told = 3
    if lost := [each.image for each in results if each.plane is None]:
        notes.append(f"{len(lost)} clouds have no plane: {listed(lost, most_told)}.")
    # Points of a rival, of those of the plane, from which on either may be the one that is meant.
    rivals = [e.image for e in results if e.plane is not None and e.plane.rival > 0.5]
    if rivals:
        notes.append(
            f"In {len(rivals)} clouds ({listed(rivals, most_told)}) another plane is nearly as "
            "large: the larger one was taken, which need not be the same one in all clouds. Cut "
            "the other one off with --range, or cut it out of the clouds."
        )
    return notes
