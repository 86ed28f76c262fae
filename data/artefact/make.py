"""Make the simulated raw points of this folder again: ``python -m data.artefact.make``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.artefact.probed_artefact import csv_text, exact_rows
from suta_calib.measurements import Artefact, Landmark, read_artefact, write_artefact, write_text

FOLDER = Path(__file__).resolve().parent
DRAWING = FOLDER.parent / "suta" / "artefact.yaml"
# What the workshop made of the drawing, and what the tracker makes of that.
MADE = 20e-6
NOISE = 1e-6
BENT, BENT_BY = "S2", np.array([0.15e-3, -0.1e-3, 0.0])


def main() -> None:
    """Write a sound artefact's points, and those of one with a bent pillar and a slipped probe."""
    drawing = read_artefact(DRAWING)
    random = np.random.default_rng(1)
    sound = {name: made(mark, random) for name, mark in drawing.landmarks.items()}
    datum = sound["O"].position * [1, 1, 0]
    sound = {n: Landmark(n, m.position - datum, m.rotation) for n, m in sound.items()}
    truth = Artefact("simulated artefact (truth)", sound)
    write_artefact(FOLDER / "truth.yaml", truth)
    rows = exact_rows(truth)
    note = "simulated raw points of an artefact; no instrument was there"
    write_text(FOLDER / "points.csv", csv_text(rows, NOISE, np.random.default_rng(2), note))
    worse = [
        (feature, name, k, point + bent(feature, name) + slipped(feature, name, k))
        for feature, name, k, point in rows
    ]
    text = csv_text(worse, NOISE, np.random.default_rng(3), note)
    write_text(FOLDER / "points_damaged.csv", text)


def made(mark: Landmark, random: np.random.Generator) -> Landmark:
    """A landmark as it was made, not as it was drawn."""
    return Landmark(mark.name, mark.position + MADE * random.standard_normal(3), mark.rotation)


def bent(feature: str, name: str) -> np.ndarray:
    """The bent pillar's top, holes and flats stand aside."""
    return BENT_BY if name == BENT and feature in ("top", "hole", "flat") else np.zeros(3)


def slipped(feature: str, name: str, index: int) -> np.ndarray:
    """The probe slipped in one touch of a sound pillar's top."""
    return np.array([0, 0, -3e-5]) * ((feature, name, index) == ("top", "L1", 2))


if __name__ == "__main__":
    main()
