"""What a job holds of the geometry, and what encoders do, is told however little it states."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_job import cli
from studies import first_of

from suta_calib import CalibrationJob
from suta_calib.assessment import Assessment

SET = (
    "{kind: tracked_point, samples: 60, "
    "base_in_instrument: {position_mm: [1500, 200, -300], rotation_rpy_deg: [5, -10, 130]}}"
)
SIMULATION = """\
arm: {{urdf: {urdf}, tip: tip}}
posture_deg: {{joint_1: 15, joint_2: 175, joint_3: 160, joint_4: 110, joint_5: -90, joint_6: -125}}
errors:
{errors}noise: {{instrument_mm: 0.1, encoder_deg: 0.005}}
sets: {{calibration: {each}, validation: {each}}}
"""
JOB = """\
arm: {{urdf: {urdf}, tip: tip}}
parameters:
{unknown}observations: [{{kind: tracked_point, samples: 'calibration/*.csv'}}]
validation: [{{kind: tracked_point, samples: 'validation/*.csv'}}]
solver: {{starts: 1}}
"""
OFFSETS = '  - {select: ["*.offset"], std_deg: 0.5}\n'
GEOMETRY = "  - {select: geometric, std_mm: 0.5, std_deg: 0.1}\n"
ECCENTRIC = "  - {select: [joint_3.ecc_c1, joint_3.ecc_s1], std_deg: 0.15}\n"
BOUNDED = '  - {select: ["*.offset"], bound_deg: 5}\n'
WITH_PRIORS = (
    '  - {select: ["*.offset"], prior_deg: 0.5}\n'
    "  - {select: geometric, prior_mm: 0.5, prior_deg: 0.1}\n"
)


def judged(folder: Path, urdf: Path, errors: str, unknown: str, seed: int) -> Assessment:
    simulation, out = folder / f"{seed}.yaml", folder / f"job{seed}"
    simulation.write_text(SIMULATION.format(urdf=urdf, errors=errors, each=SET), encoding="utf-8")
    assert cli("simulate", simulation, "--out", out, "--seed", seed) == 0
    job = out / "calibration.yaml"
    job.write_text(JOB.format(urdf=urdf, unknown=unknown), encoding="utf-8")
    return CalibrationJob.load(job).run().assessment


def looks_held(found: Assessment) -> bool:
    return any("errors of dimensions that the job fixes" in note for note in found.notes)


@pytest.mark.parametrize("seed", first_of(range(1, 5)))
def test_geometry_that_is_off_and_held_is_told(tmp_path: Path, repository: Path, seed: int) -> None:
    """Offsets make up for it: tips were 2 mm off at ± 0.3 mm, and called good."""
    urdf = repository / "urdf" / "suta.urdf"
    found = judged(tmp_path, urdf, OFFSETS + GEOMETRY, BOUNDED, seed)
    assert found.level == "care"
    assert looks_held(found)


@pytest.mark.parametrize("seed", first_of(range(1, 5)))
def test_geometry_that_is_as_drawn_may_be_held(tmp_path: Path, repository: Path, seed: int) -> None:
    urdf = repository / "urdf" / "suta.urdf"
    assert not looks_held(judged(tmp_path, urdf, OFFSETS, BOUNDED, seed))


@pytest.mark.parametrize("seed", first_of(range(1, 4)))
def test_priors_do_not_hide_an_eccentric_encoder(
    tmp_path: Path, repository: Path, seed: int
) -> None:
    """More unknowns than touches were too many to judge, though priors tell most of them."""
    urdf = repository / "urdf" / "suta.urdf"
    found = judged(tmp_path, urdf, OFFSETS + GEOMETRY + ECCENTRIC, WITH_PRIORS, seed)
    assert any("joint_3 look like an eccentric encoder" in note for note in found.notes)
    sound = judged(tmp_path, urdf, OFFSETS + GEOMETRY, WITH_PRIORS, seed)
    assert not any("look like" in note for note in sound.notes)
