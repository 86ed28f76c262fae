"""Simulated sets of stereotactic navigation files with known truth.

The geometry is that of the JHU CIS course; the distortion is deliberately no polynomial, so that
a correction by polynomials is tested on what it cannot represent exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from suta_calib.arrays import FloatArray
from suta_calib.atomic import write_bytes_atomically
from suta_calib.display import Displayable
from suta_calib.geometry.numbers import rotation_from_vector
from suta_calib.stereotactic.cis_files import (
    CalibrationMarkers,
    NavigationData,
    OpticalPivot,
    Output1,
    StereotacticData,
    output1_text,
    points_text,
)
from suta_calib.stereotactic.marker_cloud import BodyPoses

# m, edge of the calibration object; where the EM base is from the optical tracker.
OBJECT: Final = 0.25


@dataclass(frozen=True, eq=False)
class StereotacticTruth(Output1):
    """The true values of simulated files.

    Attributes:
        navigation: (N_frames, 3) where the EM probe's tip was, in CT, m.
    """

    navigation: FloatArray


@dataclass(frozen=True, eq=False)
class SimulatedSet(Displayable):
    """Simulated data with their true values."""

    data: StereotacticData
    truth: StereotacticTruth

    def texts(self) -> dict[str, str]:
        """Content of the files by name; ``output1`` and ``output2`` hold the truth."""
        data, truth, file = self.data, self.truth, f"{self.data.name}-{{}}.txt".format
        body, readings, pivot, given = data.body, data.readings, data.optical_pivot, data.navigation
        markers = (len(body.base), len(body.optical), len(body.em))
        optical = np.concatenate([pivot.base, pivot.probe], axis=1)
        tables: dict[str, tuple[tuple[int, ...], tuple[FloatArray, ...]]] = {
            "calbody": (markers, (body.base, body.optical, body.em)),
            "calreadings": (
                (*markers, len(readings.em)),
                (np.concatenate([readings.base, readings.optical, readings.em], axis=1),),
            ),
            "optpivot": ((markers[0], pivot.probe.shape[1], len(optical)), (optical,)),
            "output2": ((len(truth.navigation),), (truth.navigation,)),
        }
        by_em = {"empivot": data.em_pivot}
        if given is not None:
            tables["ct-fiducials"] = ((len(given.ct_fiducials),), (given.ct_fiducials,))
            by_em |= {"em-fiducials": given.em_fiducials, "EM-nav": given.em_nav}
        for kind, frames in by_em.items():
            tables[kind] = ((frames.shape[1], len(frames)), (frames,))
        return {file("output1"): output1_text(truth, file("output1"))} | {
            file(kind): points_text(counts, file(kind), *points)
            for kind, (counts, points) in tables.items()
        }

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
        grid: the calibration object is put at ``grid`` x ``grid`` x ``grid`` places.

    Raises:
        ValueError: ``grid`` is below 2.
    """
    if grid < 2:
        raise ValueError(f"grid: found {grid}; expected 2 or more")
    random = np.random.default_rng(seed)
    waves, phases = random.uniform(-4.0, 4.0, (3, 3)), random.uniform(0.0, 2 * np.pi, 3)

    def em(points: FloatArray) -> FloatArray:
        """EM readings, with about half a wave of error over the volume in each axis."""
        bent = distortion * np.sin(points @ waves.T + phases)
        return np.asarray(points + bent + em_noise * random.standard_normal(points.shape))

    def base_poses(frames: int) -> BodyPoses:
        """``T_optical_em`` of every frame."""
        shift, turn = jiggle * random.standard_normal((2, frames, 3))
        return BodyPoses(rotation_from_vector(turn), np.array([0.0, 0.0, -1.5]) + shift)

    # The calibration object at the points of a grid, turned a little each time.
    body = CalibrationMarkers(_lattice(2, 0.15), _lattice(2, OBJECT), _lattice(3, OBJECT))
    # The corner of the EM tracker's working volume that all markers fill, and its size, m.
    places = 0.09 + _lattice(grid, 0.77 - OBJECT)
    placed = BodyPoses(rotation_from_vector(random.uniform(-0.03, 0.03, places.shape)), places)
    base, expected = base_poses(len(places)), placed.to_tracker(body.em)
    optical = base.to_tracker(placed.to_tracker(body.optical))
    readings = CalibrationMarkers(base.to_tracker(body.base), optical, em(expected))
    # Either probe turned about its tip.
    em_post = np.full(3, 0.25) + random.uniform(-0.01, 0.01, 3)
    optical_post = np.array([0.4, 0.4, 0.2]) + random.uniform(-0.01, 0.01, 3)
    pivot_frames = 12
    probe, tip = _probe(random)
    em_pivot = em(_about(em_post, tip, random, pivot_frames).to_tracker(probe))
    # The EM probe's tip in each fiducial and at the targets.
    rotation, position = rotation_from_vector(random.uniform(-0.1, 0.1, 3)), np.full(3, 0.3)
    fiducials, nav_frames = 6, 4
    ct = random.uniform(0.0, 0.2, (fiducials + nav_frames, 3))
    at_points = _about(ct @ rotation.T + position, tip, random, len(ct))
    frames = em(at_points.to_tracker(probe))
    navigation = NavigationData(ct[:fiducials], frames[:fiducials], frames[fiducials:])
    optical_probe, optical_tip = _probe(random)
    markers = _about(optical_post, optical_tip, random, pivot_frames).to_tracker(optical_probe)
    base = base_poses(pivot_frames)
    optical_pivot = OpticalPivot(base.to_tracker(body.base), base.to_tracker(markers))
    data = StereotacticData(Path(name), body, readings, em_pivot, optical_pivot, navigation)
    return SimulatedSet(data, StereotacticTruth(em_post, optical_post, expected, ct[fiducials:]))


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
