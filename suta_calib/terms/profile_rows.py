"""Which points of profiles are on the ball or the plane, beside the samples that they belong to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.errors import SamplesError
from suta_calib.geometry.planar import FEWEST_POINTS, circle_in, fitted_circle, line_in
from suta_calib.measurements.profiles import Profiles
from suta_calib.terms.poses import PoseSource
from suta_calib.units import mm
from suta_calib.words import listed


def with_profiles(
    poses: PoseSource, profiles: Profiles, radius: float | None, *, plane: bool
) -> tuple[PoseSource, str]:
    """Poses of the scans that show the surface, its points in their samples; what was left out.

    That no scan has any, or that one was taken at two postures, is a SamplesError.
    """
    scans = [str(name) for name in poses.samples.labels["scan"].tolist()]
    by_scan = profiles.by_scan()
    if not set(scans) & set(by_scan):
        raise SamplesError(
            f"scans {_quoted(scans)} in the samples and {_quoted([*by_scan])} in the profiles",
            "the same names in both",
            file=profiles.path,
            where="column 'scan'",
        )
    _check_postures(poses, scans)
    what = "plane" if plane else "ball"
    on_surface = {
        name: _on_surface(points, radius, plane=plane)
        for name, points in by_scan.items()
        if name in set(scans)
    }
    hollow = [] if plane else _hollow(on_surface)
    on_surface |= {name: on_surface[name][:0] for name in hollow}
    shown = np.array([len(on_surface.get(name, ())) > 0 for name in scans])
    if not shown.any():
        raise _nothing(profiles, by_scan, radius, plane=plane)
    without = [name for name in dict.fromkeys(scans) if name not in by_scan]
    empty = [
        name
        for name in dict.fromkeys(scans)
        if name in by_scan and not len(on_surface[name]) and name not in hollow
    ]
    lost = [
        f"no {thing} of {len(names)} of {len(set(scans))} scans ({_quoted(names)})"
        for thing, names in (("points", without), (what, empty))
        if names
    ]
    if hollow:
        lost.append(
            f"in {len(hollow)} of {len(set(scans))} scans ({_quoted(hollow)}) a hollow where the "
            "others have a ball (is z reversed there?)"
        )
    source = profiles.path or "profiles"
    shown_scans = [name for name, there in zip(scans, shown, strict=True) if there]
    most = max(len(on_surface[name]) for name in shown_scans)
    table = np.full((len(shown_scans), most, 2), np.nan)
    for row, name in enumerate(shown_scans):
        table[row, : len(on_surface[name])] = on_surface[name]
    poses = poses.take(shown)
    poses = poses.with_samples(replace(poses.samples, pixels=table))
    least = f"{FEWEST_POINTS} points" + ("" if plane else " and an arc of 25°")
    needed = f" (a {what} needs {least} or more)" if empty else ""
    return poses, f"{source}: {' and '.join(lost)}: they are left out{needed}" if lost else ""


def _hollow(found: Mapping[str, FloatArray]) -> list[str]:
    """Scans whose points are on the other half of a circle than those of most scans."""
    sides = {
        name: bool(points[:, 1].mean() > fitted_circle(points)[0][1])
        for name, points in found.items()
        if len(points)
    }
    most = 2 * sum(sides.values()) > len(sides)
    return [name for name, side in sides.items() if side != most]


def _on_surface(points: FloatArray, radius: float | None, *, plane: bool) -> FloatArray:
    """Points (k, 2) of one profile that are on the ball or the plane; none where there is none."""
    shape = line_in(points) if plane else circle_in(points, np.inf if radius is None else radius)
    return points[:0] if shape is None else points[shape.on]


def _nothing(
    profiles: Profiles, by_scan: dict[str, FloatArray], radius: float | None, *, plane: bool
) -> SamplesError:
    """The error that no profile shows what was scanned; larger arcs are said."""
    hint = "is it the right file, and plane: true where a plane was scanned?"
    if not plane and radius is not None:
        larger = [circle.radius for p in by_scan.values() if (circle := circle_in(p)) is not None]
        if larger:
            hint = (
                f"there are arcs of {mm(float(np.median(larger))):.1f} mm radius, too large for "
                f"this ball: sphere_radius_mm is {mm(radius):g}"
            )
    what = "piece of a line" if plane else "arc of a ball"
    return SamplesError(
        f"no {what} in any profile",
        "points of the plane" if plane else "points of the ball",
        file=profiles.path,
        where="profiles",
        hint=hint,
    )


def _check_postures(poses: PoseSource, scans: Sequence[str]) -> None:
    """Refuse a scan that is named at two postures; one of them is not its own."""
    first: dict[str, int] = {}
    for row, name in enumerate(scans):
        before = first.setdefault(name, row)
        if poses.postures[row] != poses.postures[before]:
            origin = poses.samples.origin
            raise SamplesError(
                f"scan {name} at another posture than in {origin[before]}",
                "each scan where it was taken",
                where=origin[row],
            )


def _quoted(names: Sequence[str]) -> str:
    """The first few of different names."""
    names = list(dict.fromkeys(names))
    # Names of scans that a message quotes.
    quoted = names[:5]
    return listed(quoted) if len(names) == len(quoted) else ", ".join([*quoted, "…"])
