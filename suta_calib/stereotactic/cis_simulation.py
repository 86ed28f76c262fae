"""Simulated sets of stereotactic navigation files with known truth.

The geometry is that of the JHU CIS course; the distortion is deliberately no polynomial, so that
a correction by polynomials is tested on what it cannot represent exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import write_bytes_atomically
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.stereotactic.cis_files import (
    CalibrationBody,
    CalibrationReadings,
    NavigationData,
    OpticalPivot,
    Output1,
    StereotacticData,
    output1_text,
    output2_text,
    points_text,
)
from suta_calib.stereotactic.marker_cloud import BodyPoses

PIVOT_FRAMES: Final = 12
FIDUCIALS: Final = 6
NAV_FRAMES: Final = 4
# m, edges of the EM tracker's base with its optical markers, and of the calibration object.
BASE, OBJECT = 0.15, 0.25
# m, the corner of the EM tracker's working volume that all markers fill, and its size.
CORNER, EXTENT = 0.09, 0.77
# m, where the tip of each probe rests, about; and the EM base from the optical tracker.
EM_POST, OPTICAL_POST = np.array([0.25, 0.25, 0.25]), np.array([0.4, 0.4, 0.2])
EM_BASE: Final = np.array([0.0, 0.0, -1.5])


@dataclass(frozen=True, eq=False)
class StereotacticTruth:
    """What the simulated files were made from.

    Attributes:
        em_post: (3,) in the EM tracker, m.
        optical_post: (3,) in the EM tracker, m.
        expected: (N_frames, N_C, 3) where the EM markers were, in the EM tracker, m.
        navigation: (N_frames, 3) where the EM probe's tip was, in CT, m.
    """

    em_post: FloatArray
    optical_post: FloatArray
    expected: FloatArray
    navigation: FloatArray


@dataclass(frozen=True, eq=False)
class SimulatedSet:
    """Simulated data and what they were made from."""

    data: StereotacticData
    truth: StereotacticTruth

    def texts(self) -> dict[str, str]:
        """Content of the files by name; ``output1`` and ``output2`` hold the truth."""
        name, given, truth = self.data.name, self.data, self.truth
        file = f"{name}-{{}}.txt".format
        output1 = Output1(truth.em_post, truth.optical_post, truth.expected)
        texts = {
            file(kind): points_text(counts, file(kind), *points)
            for kind, (counts, points) in _tables(given).items()
        }
        texts[file("output1")] = output1_text(output1, file("output1"))
        texts[file("output2")] = output2_text(truth.navigation, file("output2"))
        return texts

    def write(self, folder: str | Path) -> Path:
        """Write the files into an existing folder, with the two decimals the format has.

        Returns:
            Their common prefix.

        Raises:
            OutputError: a file cannot be written.
        """
        for name, text in self.texts().items():
            write_bytes_atomically(Path(folder) / name, text.encode())
        return Path(folder) / self.data.name


def simulate_stereotactic(
    name: str = "simulated",
    *,
    seed: int = 0,
    distortion: float = 0.0,
    em_noise: float = 0.0,
    jiggle: float = 0.0,
    grid: int = 5,
) -> SimulatedSet:
    """Simulate a whole set.

    Args:
        name: what the names of the files begin with.
        seed: of everything random.
        distortion: largest displacement of an EM reading in the working volume, per axis, about, m.
        em_noise: standard deviation of an EM reading per coordinate, m.
        jiggle: how far the optical tracker moves between frames, standard deviation per axis, m.
        grid: the calibration object is put at ``grid``³ places.

    Raises:
        ValueError: ``grid`` is below 2.
    """
    if grid < 2:
        raise ValueError(f"grid: found {grid}; expected 2 or more")
    random = np.random.default_rng(seed)
    world = _World(random, distortion, em_noise, jiggle)
    body = CalibrationBody(_lattice(2, BASE), _lattice(2, OBJECT), _lattice(3, OBJECT))
    readings, expected = world.calibration(body, grid)
    em_post, optical_post = (p + random.uniform(-0.01, 0.01, 3) for p in (EM_POST, OPTICAL_POST))
    probe, tip = _probe(random)
    em_pivot = world.em(_about(em_post, tip, random, PIVOT_FRAMES).to_tracker(probe))
    navigation, tips = world.navigation(probe, tip)
    data = StereotacticData(
        Path(name), body, readings, em_pivot, world.optical_pivot(body, optical_post), navigation
    )
    return SimulatedSet(data, StereotacticTruth(em_post, optical_post, expected, tips))


class _World:
    """Two trackers with their faults; everything true is said in the EM tracker's frame."""

    def __init__(
        self, random: np.random.Generator, distortion: float, em_noise: float, jiggle: float
    ) -> None:
        self._random, self._distortion = random, distortion
        self._em_noise, self._jiggle = em_noise, jiggle
        # About half a wave over the working volume in every direction.
        self._waves = random.uniform(-4.0, 4.0, (3, 3))
        self._phases = random.uniform(0.0, 2 * np.pi, 3)

    def em(self, points: FloatArray) -> FloatArray:
        """What the EM tracker reads: (..., 3) → (..., 3), m."""
        bent = self._distortion * np.sin(points @ self._waves.T + self._phases)
        noise = self._em_noise * self._random.standard_normal(points.shape)
        return np.asarray(points + bent + noise)

    def base_poses(self, frames: int) -> BodyPoses:
        """``T_optical_em`` of every frame."""
        shift = self._jiggle * self._random.standard_normal((frames, 3))
        turn = self._jiggle * self._random.standard_normal((frames, 3))
        return BodyPoses(rotation_from_vector(turn), EM_BASE + shift)

    def calibration(
        self, body: CalibrationBody, grid: int
    ) -> tuple[CalibrationReadings, FloatArray]:
        """The calibration object at the points of a grid, turned a little each time."""
        places = CORNER + _lattice(grid, EXTENT - OBJECT)
        turn = rotation_from_vector(self._random.uniform(-0.03, 0.03, places.shape))
        placed, base = BodyPoses(turn, places), self.base_poses(len(places))
        expected = placed.to_tracker(body.em)
        optical = base.to_tracker(placed.to_tracker(body.optical))
        return CalibrationReadings(base.to_tracker(body.base), optical, self.em(expected)), expected

    def optical_pivot(self, body: CalibrationBody, post: FloatArray) -> OpticalPivot:
        """An optical probe of its own turned about its tip."""
        probe, tip = _probe(self._random)
        markers = _about(post, tip, self._random, PIVOT_FRAMES).to_tracker(probe)
        base = self.base_poses(PIVOT_FRAMES)
        return OpticalPivot(base.to_tracker(body.base), base.to_tracker(markers))

    def navigation(self, probe: FloatArray, tip: FloatArray) -> tuple[NavigationData, FloatArray]:
        """The EM probe's tip in each fiducial and at the targets; the targets in CT, m."""
        random = self._random
        rotation, position = rotation_from_vector(random.uniform(-0.1, 0.1, 3)), np.full(3, 0.3)
        ct = random.uniform(0.0, 0.2, (FIDUCIALS + NAV_FRAMES, 3))
        em = ct @ rotation.T + position
        frames = self.em(_about(em, tip, random, len(em)).to_tracker(probe))
        given = NavigationData(ct[:FIDUCIALS], frames[:FIDUCIALS], frames[FIDUCIALS:])
        return given, ct[FIDUCIALS:]


def _lattice(n: int, size: float) -> FloatArray:
    """(n³, 3) points of a cube, the last coordinate fastest, m."""
    axis = np.linspace(0.0, size, n)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def _probe(random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """(6, 3) markers and (3,) tip of a probe, m."""
    markers = 0.05 * np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [0, 2, 0], [0, 0, 1]])
    return markers - markers.mean(axis=0), np.array([0.0, 0.0, -0.1]) + random.normal(0, 0.01, 3)


def _about(post: FloatArray, tip: FloatArray, random: np.random.Generator, n: int) -> BodyPoses:
    """N poses of a probe whose tip stays at a post, (3,), or is at one after the other, (n, 3)."""
    rotation = rotation_from_vector(random.uniform(-0.6, 0.6, (n, 3)))
    return BodyPoses(rotation, post - rotation @ tip)


def _tables(data: StereotacticData) -> Mapping[str, tuple[tuple[int, ...], tuple[FloatArray, ...]]]:
    """Counts and points of every input file by kind."""
    body, seen, pivot, given = data.body, data.readings, data.optical_pivot, data.navigation
    markers = (len(body.base), len(body.optical), len(body.em))
    frames = np.concatenate([seen.base, seen.optical, seen.em], axis=1)
    optical = np.concatenate([pivot.base, pivot.probe], axis=1)
    probe = pivot.probe.shape[1]
    tables = {
        "calbody": (markers, (body.base, body.optical, body.em)),
        "calreadings": ((*markers, len(frames)), (frames,)),
        "optpivot": ((markers[0], probe, len(optical)), (optical,)),
    }
    by_em = {"empivot": data.em_pivot}
    if given is not None:
        tables["ct-fiducials"] = ((len(given.ct_fiducials),), (given.ct_fiducials,))
        by_em |= {"em-fiducials": given.em_fiducials, "EM-nav": given.em_nav}
    em_tables = {kind: ((seen.shape[1], len(seen)), (seen,)) for kind, seen in by_em.items()}
    return tables | em_tables
