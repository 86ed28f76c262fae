"""Simulations of the SUTA in a folder of their own."""

from __future__ import annotations

from pathlib import Path

from suta_calib.simulation import (
    Simulation,
    read_simulation,
    simulate,
)

ARTEFACT = """
landmarks:
  A: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 20], sigma_mm: 0.5}
  B: {position_mm: [60, 10, 60], rotation_rpy_deg: [180, 0, 100], sigma_mm: 0.5}
  C: {position_mm: [-20, 70, 20], sigma_mm: 0.5}
"""
EXACT = """
arm: {urdf: URDF, tip: tip}
seed: 3
errors:
  - {select: [geometric], std_mm: 1, std_deg: 0.1}
  - {select: ["*.offset"], std_deg: 1}
  - {select: [joint_2.offset], value_deg: 4.1}
sets:
  calibration:
    kind: pairwise_distance
    artefact: artefact.yaml
    repeats: 2
    placements:
      P1: {position_mm: [437.5, 12.5, 0], rotation_rpy_deg: [0, 0, -105]}
      P2: {position_mm: [412.5, 37.5, 0], rotation_rpy_deg: [0, 0, 30]}
  fixed_point:
    kind: fixed_point
    points: {F1: {position_mm: [400, 0, 100]}}
    directions: 12
    cone_deg: 40
  tracked:
    kind: tracked_point
    samples: 30
    orientation: true
    base_in_instrument: {position_mm: [1000, 2000, 300], rotation_rpy_deg: [10, 20, 30]}
"""


class Folder:
    """A folder with an artefact and a simulation file that can be changed."""

    def __init__(self, path: Path, urdf: Path) -> None:
        self.path, self.urdf = path, urdf
        (path / "artefact.yaml").write_text(ARTEFACT)

    def file(self, text: str = EXACT) -> Path:
        file = self.path / "simulation.yaml"
        file.write_text(text.replace("URDF", str(self.urdf)))
        return file

    def simulate(self, text: str = EXACT, seed: int | None = None) -> Simulation:
        return simulate(read_simulation(self.file(text)), seed)


def with_noise(noise: str) -> str:
    return EXACT.replace("sets:\n", f"noise: {noise}\nsets:\n", 1)
