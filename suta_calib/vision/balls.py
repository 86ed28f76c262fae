"""Balls of known radius in clouds of points that a depth camera saw."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError
from suta_calib.geometry.ball import Ball, ball_in
from suta_calib.measurements.cloud_files import SUFFIXES, read_cloud
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.threads import usable_cores
from suta_calib.units import mm
from suta_calib.words import listed

# Points of a rival, of those of the ball, from which on either may be the one.
_RIVAL: Final = 0.5
_MOST_TOLD: Final = 3


@dataclass(frozen=True, eq=False)
class SearchedCloud(Displayable):
    """Result for one ball in one cloud.

    Attributes:
        image: what the cloud is called.
        name: what the ball is called.
        radius: of the ball, m.
        ball: where it is; None where it was not found.
        reason: why not; empty where it was.
    """

    image: str
    name: str
    radius: float
    ball: Ball | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class BallSearch(Displayable):
    """Balls in clouds.

    Attributes:
        clouds: how many were searched.
        searched: every ball in every cloud, in order.
        points: centres of those that were found.
        assessment: how far to trust it.
    """

    clouds: int
    searched: Sequence[SearchedCloud]
    points: SeenPoints
    assessment: Assessment


def find_clouds(paths: Iterable[Path]) -> dict[str, Path]:
    """Clouds by the names of their files, of files and of folders, in order.

    Raises:
        InputError: no such file, no cloud in a folder, or two of one name.
    """
    clouds = dict[str, Path]()
    for path in paths:
        files = [path]
        if path.is_dir():
            files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES)
            if not files:
                kinds = ", ".join(sorted(SUFFIXES))
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


def find_balls(
    clouds: Mapping[str, Path],
    radii: Mapping[str, float],
    unit: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> BallSearch:
    """Find balls in clouds.

    Args:
        clouds: files by name.
        radii: of the balls by name, m.
        unit: as of `read_cloud`.
        progress: is told how many clouds are done, and of how many.

    Raises:
        InputError: a cloud cannot be read, or no ball is in any of them.
    """

    def search(image: str) -> list[SearchedCloud]:
        points = read_cloud(clouds[image], unit)
        return [
            _searched(image, name, radius, ball_in(points, radius))
            for name, radius in radii.items()
        ]

    searched = list[SearchedCloud]()
    with ThreadPoolExecutor(usable_cores()) as pool:
        try:
            for done, each in enumerate(pool.map(search, clouds), 1):
                searched += each
                if progress is not None:
                    progress(done, len(clouds))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    balls = [(each, each.ball) for each in searched if each.ball is not None]
    if not balls:
        raise SamplesError(
            f"{searched[0].reason} in any cloud",
            "the ball as half a sphere or more, towards the camera",
            file=next(iter(clouds.values())),
            hint="check the radius (half the diameter) and the unit of the clouds; a cloud must be "
            "in the camera's own frame, with the camera at the origin",
        )
    points = SeenPoints(
        np.array([each.image for each, _ in balls]),
        np.array([each.name for each, _ in balls]),
        np.array([ball.centre for _, ball in balls]),
        np.array([ball.sigma for _, ball in balls]),
    )
    sentence = f"{len(balls)} of {len(searched)} balls found in {len(clouds)} clouds."
    return BallSearch(
        len(clouds), searched, points, Assessment.of(sentence, care=_notes(searched, radii))
    )


def _searched(image: str, name: str, radius: float, ball: Ball | None) -> SearchedCloud:
    reason = "" if ball else f"no ball of radius {mm(radius):.4g} mm"
    return SearchedCloud(image, name, radius, ball, reason)


def _notes(searched: Sequence[SearchedCloud], radii: Mapping[str, float]) -> list[str]:
    """What must be known: balls that were not found, that have a rival, or another radius."""
    notes = list[str]()
    lost = [f"{each.image} ({each.name})" for each in searched if each.ball is None]
    if lost:
        notes.append(f"{len(lost)} balls were not found: {listed(lost, _MOST_TOLD)}.")
    rivals = [e.image for e in searched if e.ball is not None and e.ball.rival > _RIVAL]
    if rivals:
        notes.append(
            f"In {len(rivals)} clouds ({listed(rivals, _MOST_TOLD)}) another ball of this radius "
            "is nearly as plain: which one was meant? Cut it out of the clouds, or use balls of "
            "different radii."
        )
    for name, radius in radii.items():
        balls = [e.ball for e in searched if e.name == name and e.ball is not None]
        other_radii = [ball.radius for ball in balls if not ball.fits(radius)]
        if other_radii and 2 * len(other_radii) >= len(balls):
            middle, std = (float(np.median(values)) for values in np.transpose(other_radii))
            notes.append(
                f"Ball {name} looks like one of radius {mm(middle):.4g} ± {mm(std):.2g} mm, not "
                f"{mm(radius):.4g} mm: its centre is then off along the ray by about "
                f"{mm(abs(middle - radius)):.2g} mm. Measure the ball, or look for glare on it: a "
                "matt ball is seen best."
            )
    return notes
