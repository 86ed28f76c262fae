"""Simulated raw points of a small known artefact, and ways to spoil them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from data.artefact.probed_artefact import ProbingPattern, Row, csv_text, exact_rows
from suta_calib.arrays import FloatArray
from suta_calib.certification.points import PLAIN, CertificationOptions, RawPoints, read_raw_points
from suta_calib.certification.procedure import certify
from suta_calib.certification.result import Certification
from suta_calib.geometry.numbers import rotation_from_rpy, rpy_from_rotation
from suta_calib.measurements import Artefact, Landmark

NOISE = 1e-6
PLACES = {
    "O": (0.0, 0.0, 40.0, 30.0),
    "M1": (65.0, 24.0, 40.0, -30.0),
    "L1": (36.0, -46.0, 60.0, 137.0),
    "L2": (-38.0, 32.0, 60.0, -145.0),
    "S1": (-64.0, -62.0, 20.0, 75.0),
    "S2": (50.0, 68.0, 20.0, 170.0),
}
Change = Callable[[str, str, int, FloatArray], FloatArray]


def truth() -> Artefact:
    """Six pillars of three heights."""
    marks = {
        name: Landmark(
            name, 1e-3 * np.array([x, y, z]), rotation_from_rpy(np.radians([180.0, 0.0, yaw]))
        )
        for name, (x, y, z, yaw) in PLACES.items()
    }
    return Artefact("simulated", marks)


def unchanged(_feature: str, _name: str, _index: int, point: FloatArray) -> FloatArray:
    """No damage."""
    return point


def moved(by: Sequence[float], feature: str, name: str = "", indices: Sequence[int] = ()) -> Change:
    """Touches of a feature elsewhere, of one landmark or of all, those of some numbers or all."""

    def change(touched: str, mark: str, index: int, point: FloatArray) -> FloatArray:
        here = touched == feature and name in ("", mark) and (not indices or index in indices)
        return point + np.array(by) * here

    return change


def rows(change: Change = unchanged, leave_out: Sequence[str] = ()) -> list[Row]:
    """Exact touches, some features left out, points moved by ``change``."""
    exact = exact_rows(truth(), ProbingPattern())
    return [
        (feature, name, index, change(feature, name, index, point))
        for feature, name, index, point in exact
        if feature not in leave_out
    ]


def write_points(
    path: Path,
    change: Change = unchanged,
    leave_out: Sequence[str] = (),
    *,
    noise: float = NOISE,
    seed: int = 0,
) -> Path:
    """A file of raw points."""
    random = np.random.default_rng(seed)
    path.write_text(csv_text(rows(change, leave_out), noise, random), encoding="utf-8")
    return path


def raw_points(
    folder: Path,
    change: Change = unchanged,
    leave_out: Sequence[str] = (),
    *,
    noise: float = NOISE,
    seed: int = 0,
) -> RawPoints:
    """The same, read."""
    path = write_points(folder / "points.csv", change, leave_out, noise=noise, seed=seed)
    return read_raw_points(path)


def certified(
    folder: Path,
    change: Change = unchanged,
    leave_out: Sequence[str] = (),
    options: CertificationOptions = PLAIN,
    *,
    noise: float = NOISE,
    seed: int = 0,
) -> Certification:
    """The same, certified."""
    return certify(raw_points(folder, change, leave_out, noise=noise, seed=seed), options)


def positions(found: Certification) -> FloatArray:
    """(n, 3), m."""
    return np.array([mark.position for mark in found.landmarks])


def yaws(artefact: Artefact) -> FloatArray:
    """(n,) turn of each seated tip, rad."""
    return np.array(
        [
            rpy_from_rotation(mark.rotation)[2]
            for mark in artefact.landmarks.values()
            if mark.rotation is not None
        ]
    )


TRUE_POSITIONS = np.array([mark.position for mark in truth().landmarks.values()])
