"""Balls of known radius in clouds of points that a depth camera saw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from suta_calib.assessment import Assessment
from suta_calib.display import Displayable
from suta_calib.errors import SamplesError
from suta_calib.geometry.ball import Ball, ball_in
from suta_calib.measurements.cloud_files import Cloud
from suta_calib.measurements.seen_points import SeenPoints
from suta_calib.units import mm
from suta_calib.vision.clouds import POINT_FILES, CloudReader, dropped_words
from suta_calib.vision.clouds import searched as searched_clouds
from suta_calib.words import listed


@dataclass(frozen=True, eq=False)
class SearchedCloud(Displayable):
    """Result for one ball in one cloud.

    Attributes:
        image: what the cloud is called.
        name: what the ball is called.
        radius: of the ball, m.
        count, dropped: points of the cloud, and those of it without a place.
        ball: where it is; None where it was not found.
        reason: why not; empty where it was.
    """

    image: str
    name: str
    radius: float
    count: int
    dropped: int
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


def find_balls(
    clouds: Mapping[str, Path],
    radii: Mapping[str, float],
    reader: CloudReader = POINT_FILES,
    progress: Callable[[int, int], None] | None = None,
) -> BallSearch:
    """Find balls in clouds.

    Args:
        clouds: files by name.
        radii: of the balls by name, m.
        reader: how they are read.
        progress: is told how many clouds are done, and of how many.

    Raises:
        InputError: a cloud cannot be read, or no ball is in any of them.
    """

    def search(image: str, cloud: Cloud) -> list[SearchedCloud]:
        return [
            _searched(image, name, radius, ball_in(cloud.points, radius), cloud)
            for name, radius in radii.items()
        ]

    by_cloud = searched_clouds(clouds, reader, search, progress)
    searched = [entry for of_cloud in by_cloud for entry in of_cloud]
    balls = [(entry, entry.ball) for entry in searched if entry.ball is not None]
    if not balls:
        raise SamplesError(
            f"{searched[0].reason} in any cloud",
            "the ball as half a sphere or more, towards the camera",
            file=next(iter(clouds.values())),
            hint="check the radius (half the diameter) and the unit of the clouds; a cloud must be "
            "in the camera's own frame, with the camera at the origin",
        )
    points = SeenPoints(
        np.array([entry.image for entry, _ in balls]),
        np.array([entry.name for entry, _ in balls]),
        np.array([ball.centre for _, ball in balls]),
        np.array([ball.sigma for _, ball in balls]),
    )
    count, dropped = np.sum([(of[0].count, of[0].dropped) for of in by_cloud], axis=0).tolist()
    sentence = f"{len(balls)} of {len(searched)} balls found in {len(clouds)} clouds."
    assessment = Assessment.of(
        sentence + dropped_words(dropped, count), care=_notes(searched, radii)
    )
    return BallSearch(len(clouds), searched, points, assessment)


def _searched(
    image: str, name: str, radius: float, ball: Ball | None, cloud: Cloud
) -> SearchedCloud:
    reason = "" if ball else f"no ball of radius {mm(radius):.4g} mm"
    return SearchedCloud(image, name, radius, cloud.count, cloud.dropped, ball, reason)


def _notes(searched: Sequence[SearchedCloud], radii: Mapping[str, float]) -> list[str]:
    """What must be known: balls that were not found, that have a rival, or another radius."""
    notes = list[str]()
    lost = [f"{each.image} ({each.name})" for each in searched if each.ball is None]
    most_told = 3
    if lost:
        notes.append(f"{len(lost)} balls were not found: {listed(lost, most_told)}.")
    # Points of a rival, of those of the ball, from which on either may be the one.
    rivals = [e.image for e in searched if e.ball is not None and e.ball.rival > 0.5]
    if rivals:
        notes.append(
            f"In {len(rivals)} clouds ({listed(rivals, most_told)}) another ball of this radius "
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
