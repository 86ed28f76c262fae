"""A small emulated arm for tests: true errors, two placements of a small artefact."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from suta_calib.device import decoder_for
from suta_calib.device.description import DeviceSpec
from suta_calib.device.reading import Reading
from suta_calib.emulation import Emulation, Stops, Timing, artefact_set, device_of, frames, stops
from suta_calib.geometry.numbers import rotation_from_rpy
from suta_calib.measurements import read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.simulation import NoiseLevels, PoseSpec

TRUTH = {"joint_2.offset": 0.02, "joint_3.offset": -0.015, "joint_4.z": 0.574, "tip.y": -0.251}
ARTEFACT = """
landmarks:
  A: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 20]}
  B: {position_mm: [60, 10, 60], rotation_rpy_deg: [180, 0, 100]}
  C: {position_mm: [-20, 70, 20]}
"""
PLACEMENTS = {
    "P1": PoseSpec(rotation_from_rpy(np.deg2rad([0, 0, -105])), np.array([0.4375, 0.0125, 0.0])),
    "P2": PoseSpec(rotation_from_rpy(np.deg2rad([0, 0, 30])), np.array([0.4125, 0.0375, 0.0])),
}


def write_artefact(folder: Path) -> Path:
    file = folder / "artefact.yaml"
    file.write_text(ARTEFACT)
    return file


def landmark_stops(arm: ArmModel, folder: Path, rest: float = 1.0, move: float = 0.5) -> Stops:
    """Exactly seated on every landmark at both placements."""
    plan = artefact_set(write_artefact(folder), PLACEMENTS, 1, NoiseLevels())
    return stops(arm, TRUTH, plan, timing=Timing(rest, move))


def true_landmarks(folder: Path, labels: list[dict[str, str]]) -> np.ndarray:
    """(n, 3) where the tip must be at rests with these labels, m."""
    marks = read_artefact(folder / "artefact.yaml").landmarks
    poses = [PLACEMENTS[each["placement"]] for each in labels]
    local = [marks[each["landmark"]].position for each in labels]
    return np.array([T.rotation @ p + T.position for T, p in zip(poses, local, strict=True)])


def decoded(emulation: Emulation, seconds: float) -> tuple[list[Reading], object]:
    """What a decoder makes of an emulation, without a port; and the decoder's statistics."""
    decoder = decoder_for(emulation.device)
    readings: list[Reading] = []
    for due, data in frames(emulation, seconds):
        readings += decoder.feed(data, due)
    return readings, decoder.statistics


def listen(
    port: str,
    device: DeviceSpec,
    seconds: float,
    until: Callable[[list[Reading]], bool] = lambda _: False,
) -> list[Reading]:
    """Read a port for a while, until there is what is wanted, or until it vanishes."""
    decoder, readings = decoder_for(device), []
    file = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        end = time.perf_counter() + seconds
        while time.perf_counter() < end and not until(readings):
            if not select.select([file], [], [], 0.02)[0]:
                continue
            data = os.read(file, 65536)
            if not data:
                break
            readings += decoder.feed(data, time.perf_counter())
    except OSError:
        pass
    finally:
        os.close(file)
    return readings


def angles(readings: list[Reading]) -> np.ndarray:
    return np.array([each.angles for each in readings])


__all__ = [
    "PLACEMENTS",
    "TRUTH",
    "angles",
    "decoded",
    "device_of",
    "landmark_stops",
    "listen",
    "true_landmarks",
    "write_artefact",
]
