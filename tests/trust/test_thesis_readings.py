"""What the two kinematic tables of the thesis let its distances tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from suta_calib import (
    ArmPoses,
    PairwiseDistance,
    Problem,
    Samples,
    Selection,
    observe,
    read_artefact,
    simulate,
)
from suta_calib.simulation import read_simulation


@pytest.mark.parametrize(
    ("name", "tool", "told", "held"),
    [
        ("suta", ("tip.y", "tip.z"), 10, {"joint_1.offset", "joint_2.z", "tip.y"}),
        (
            "suta_table_4_2",
            ("tip.z",),
            8,
            {"joint_1.offset", "joint_2.z", "joint_6.offset", "tip.z"},
        ),
    ],
)
def test_a_reading_decides_what_can_be_told(
    repository: Path, name: str, tool: tuple[str, ...], told: int, held: set[str]
) -> None:
    description = read_simulation(repository / "data/thesis/simulation.yaml")
    touched = description.sets[0]
    places = {label: touched.places[label] for label in ("A_O", "C_A", "C_B")}
    touched = replace(touched, repeats=1, places=places)
    urdf = repository / f"urdf/{name}.urdf"
    made = simulate(
        replace(description, arm=replace(description.arm, urdf=urdf), errors=(), sets=(touched,)),
        0,
    )
    samples = Samples.concatenate([file.samples for file in made.files])
    unknown = made.arm.select(
        Selection(("joint_*.offset",), bound_rad=np.radians(15)),
        Selection(("joint_[2-6].z", *tool), bound_m=0.03),
    )
    artefact = read_artefact(repository / "data/thesis/artefact.yaml")
    found = observe(Problem([PairwiseDistance(ArmPoses(made.arm, samples), artefact)], unknown))
    assert found.rank == told
    assert set(found.unidentified) == held
