"""Every command over a job, for every kind of observation: from ``simulate`` to ``tip-map``.

A kind that is added to `suta_calib.terms.KINDS` fails here until it has a scene."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cli_job import answer, cli, spoken
from simulated import SUTA_URDF

from suta_calib.terms import KINDS, Term

ARTEFACT = """\
name: four pillars
landmarks:
  A: {position_mm: [0, 0, 40], rotation_rpy_deg: [180, 0, 30], sigma_mm: 0.001}
  B: {position_mm: [90, 0, 20], rotation_rpy_deg: [180, 20, 0], sigma_mm: 0.001}
  C: {position_mm: [0, 110, 60], rotation_rpy_deg: [160, 0, 0], sigma_mm: 0.001}
  D: {position_mm: [80, 100, 30], rotation_rpy_deg: [200, 0, 0], sigma_mm: 0.001}
"""
PLACES = """\
      S1: {position_mm: [400, 0, 0]}
      S2: {position_mm: [0, 400, 0]}
      S3: {position_mm: [-400, 0, 0]}
      S4: {position_mm: [0, -400, 0]}
"""
EDGES = """\
      S1: {position_mm: [400, 50, 0], rotation_rpy_deg: [0, 6, 20]}
      S2: {position_mm: [-50, 400, 50], rotation_rpy_deg: [23, 0, 70]}
      S3: {position_mm: [-400, -50, 0], rotation_rpy_deg: [-6, -17, 130]}
      S4: {position_mm: [50, -400, 50], rotation_rpy_deg: [28, 17, 50]}
"""
# Of six joints few postures hold one thing in one pose: many grips take their place.
GRIPS = "".join(
    f"      S{k}: {{position_mm: [{x}, {y}, {z}], "
    f"rotation_rpy_deg: [{180 - tilt}, {tilt}, {yaw}]}}\n"
    for k, (x, y, z, tilt, yaw) in enumerate(
        [
            (400, 0, 0, 0, 20),
            (0, 400, 50, 10, 70),
            (-400, 0, 0, -10, 130),
            (0, -400, 50, 20, 50),
            (300, 300, 0, 5, -60),
        ],
        1,
    )
)
ANCHORS = """\
      S1: {position_mm: [250, 0, -200]}
      S2: {position_mm: [0, 250, -200]}
      S3: {position_mm: [-200, -200, -200]}
"""


@dataclass(frozen=True)
class Case:
    """What is simulated of a kind, and what its row of a job says.

    Attributes:
        kind: of observation.
        fitted, held_out: keys of the two sets, in YAML.
        row: keys of the job's row.
        told: a parameter of the arm that this kind tells.
        place: an own unknown that validation shares.
        unit: of its errors.
    """

    kind: str
    fitted: str
    held_out: str
    row: str = ""
    told: str = "joint_3.offset"
    place: str = ""
    unit: str = "mm"


def touching(kind: str, places: str, directions: int = 12, **more: str) -> Case:
    """A place is touched again in the held-out set, from elsewhere."""
    key, keys = KINDS[kind].place, more.pop("keys", "")
    fitted = f"    {key}s:\n{places}    directions: {directions}\n    cone_deg: 40\n{keys}"
    first = places.splitlines()[0]
    again = f"    {key}s:\n{first}\n    directions: 6\n    cone_deg: 30\n{keys}"
    return Case(kind, fitted, again, **more)


ON_ARTEFACT = (
    """\
    artefact: artefact.yaml
    repeats: 2
    placements:
      P1: {position_mm: [380, 0, 0]}
      P2: {position_mm: [0, 380, 0], rotation_rpy_deg: [0, 0, 90]}
      P3: {position_mm: [-380, 0, 50], rotation_rpy_deg: [0, 0, 180]}
      P4: {position_mm: [0, -380, 50], rotation_rpy_deg: [0, 0, -90]}
""",
    "    artefact: artefact.yaml\n    placements: {P5: {position_mm: [300, 200, 0]}}\n",
)
CASES = {
    "pairwise_distance": Case("pairwise_distance", *ON_ARTEFACT, "artefact: artefact.yaml, "),
    "landmark": Case("landmark", *ON_ARTEFACT, "artefact: artefact.yaml, "),
    "fixed_point": touching("fixed_point", PLACES, place="fixed_point[S1].z"),
    "plane": touching(
        "plane",
        EDGES,
        keys="    size_mm: 150\n    probe_radius_mm: 10\n",
        row="probe_radius_mm: 10, ",
        place="plane[S1].z",
    ),
    "line": touching("line", EDGES, place="line[S1].x"),
    "range": touching(
        "range", ANCHORS, 18, keys="    length_mm: [200, 400]\n", place="anchor[S1].z"
    ),
    "range of unknown radius": touching(
        "range", ANCHORS, 18, keys="    length_mm: 300\n", place="radius[S1]"
    ),
    "contact": touching("contact", PLACES, place="spot[S1].z"),
    "closed_loop": touching("closed_loop", GRIPS, 14, place="grip[S1].z"),
    "tracked_point": Case(
        "tracked_point", "    samples: 40\n", "    samples: 15\n", place="base.x"
    ),
    "tracked_point with targets": Case(
        "tracked_point",
        "    samples: 25\n"
        "    targets: {A: {position_mm: [50, 0, 20]}, B: {position_mm: [0, 40, 0]}}\n",
        "    samples: 10\n    targets: {A: {position_mm: [50, 0, 20]}}\n",
        place="target[A].x",
    ),
    "hand_eye": Case(
        "hand_eye",
        *(
            f"    samples: {n}\n    eye_in_tip: {{position_mm: [20, -50, 80]}}\n"
            "    target_in_base: {position_mm: [600, 200, -100]}\n"
            for n in (30, 10)
        ),
        place="hand_eye.x",
    ),
    "points": Case(
        "points",
        *(
            f"    samples: {n}\n    camera_pose: {{position_mm: [20, -50, 80]}}\n"
            "    points: {A: {position_mm: [400, 200, -100]}, B: {position_mm: [450, 300, -80]}}\n"
            for n in (30, 10)
        ),
        place="point[A].x",
    ),
    "gravity": Case(
        "gravity", "    samples: 40\n", "    samples: 15\n", place="sensor.rx", unit="deg"
    ),
    # Of a package outside, tests/support/outside_package: angles alone.
    "inclinometer": Case(
        "inclinometer", "    samples: 40\n", "    samples: 15\n", place="sensor.rx", unit="deg"
    ),
    # Plain numbers alone.
    "accelerometer": Case(
        "accelerometer", "    samples: 40\n", "    samples: 15\n", place="sensor.rx", unit=""
    ),
}
# Commands that take seconds are tried on all of them only where there is time.
QUICK = ("range", "tracked_point with targets", "inclinometer")
AT_LENGTH = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in CASES
]


@pytest.fixture(scope="module", params=CASES)
def job(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated job of one kind."""
    case = CASES[request.param]
    folder = tmp_path_factory.mktemp("kind")
    (folder / "arm.urdf").write_bytes(SUTA_URDF.read_bytes())
    (folder / "artefact.yaml").write_text(ARTEFACT)
    (folder / "simulation.yaml").write_text(
        "arm: {urdf: arm.urdf, tip: tip}\nseed: 3\n"
        "errors: [{select: ['*.offset'], std_deg: 0.5}]\n"
        "noise: {seating_mm: 0.05, seating_deg: 0.02, instrument_mm: 0.05, instrument_deg: 0.02,"
        " instrument: 0.0004}\n"
        "sets:\n"
        f"  calibration:\n    kind: {case.kind}\n{case.fitted}"
        f"  validation:\n    kind: {case.kind}\n{case.held_out}"
    )
    (folder / "job.yaml").write_text(
        "arm: {urdf: arm.urdf, tip: tip}\n"
        "parameters: [{select: ['joint_*.offset'], bound_deg: 5}]\n"
        f"observations: [{{kind: {case.kind}, {case.row}samples: 'calibration/*.csv'}}]\n"
        f"validation: [{{kind: {case.kind}, {case.row}samples: 'validation/*.csv'}}]\n"
    )
    assert cli("simulate", folder / "simulation.yaml", "--out", folder) == 0
    (folder / "case").write_text(request.param)
    return folder / "job.yaml"


def case_of(job: Path) -> Case:
    return CASES[(job.parent / "case").read_text()]


# Have their scenes beside the term, in tests/terms.
BESIDE = {"camera_view", "plane_view", "profile"}


def test_every_kind_has_a_scene() -> None:
    assert set(KINDS) == {case.kind for case in CASES.values()} | BESIDE


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_it_is_begun(kind: type[Term], tmp_path: Path) -> None:
    new = ("--tip", "tip", "--kind", kind.kind, "--out", tmp_path)
    assert cli("init", SUTA_URDF, *new) == 0
    assert f"# {kind.kind}: " in (tmp_path / "calibration.yaml").read_text()
    header = (tmp_path / "calibration" / "samples.csv").read_text().strip().split(",")
    assert set(kind.columns.labels) <= set(header)
    assert not set(kind.columns.common_labels) & set(header)


def test_it_is_observed(job: Path) -> None:
    found = answer("observe", job)
    assert found["parameters"][case_of(job).told]["state"] == "identified"
    assert all(each["sentence"] for each in found["explanations"])


def test_it_is_calibrated_and_validated(job: Path) -> None:
    """Held-out errors fall to the noise; what is seen or touched again keeps its fitted place."""
    case, out = case_of(job), job.parent / "results"
    found = answer("calibrate", job, "--out", out)
    assert found["verdict"]["usable"], found["verdict"]
    metrics, rms = found["metrics"]["validation"], f"rms_{case.unit}".rstrip("_")
    limit = 0.2 if case.unit else 0.005
    assert metrics["after"][rms] < limit < metrics["before"][rms]
    if case.place:
        assert found["parameters"][case.place]["state"] == "identified"
    again = answer("validate", out / "calibrated.urdf", job)
    assert again["metrics"]["validation"]["after"]["count"] == metrics["after"]["count"]


def test_an_arm_that_is_right_is_held(job: Path) -> None:
    """Only what a kind itself leaves open is estimated: the pose of a camera, say."""
    case, held = case_of(job), job.parent / "held.yaml"
    if not case.place:
        pytest.skip("nothing but the arm is unknown")
    free = "parameters: [{select: ['joint_*.offset'], bound_deg: 5}]"
    held.write_text(job.read_text().replace(free, "parameters: []"))
    # The simulated arm is not right, so the answer may be one that must not be used.
    ended, out, err = spoken("calibrate", held, "--out", job.parent / "held", "--json")
    assert ended in (0, 1), err
    found = json.loads(out)
    assert found["parameters"][case.place]["state"] == "identified"
    assert not any(name.startswith("joint_") for name in found["parameters"])


def analysed(job: Path, command: str, *options: object) -> dict[str, Any]:
    found = answer(command, job, *options, "--out", job.parent / command)
    assert found["verdict"]["usable"], found["verdict"]
    return found


@pytest.mark.parametrize(
    ("command", "options"),
    [("study", ("--unit", "sample", "--trials", 2, "--sizes", "25", "--jobs", 1)), ("budget", ())],
    ids=["study", "budget"],
)
def test_it_is_analysed(job: Path, command: str, options: tuple[object, ...]) -> None:
    analysed(job, command, *options)


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("outliers", ()),
        ("study", ("--kind", "monte-carlo", "--trials", 10, "--jobs", 1)),
        ("plan", ("-n", 1)),
        ("extend", ("--quick",)),
        ("tip-map", ("--grid", 5)),
    ],
    ids=["outliers", "monte-carlo", "plan", "extend", "tip-map"],
)
@pytest.mark.parametrize("job", AT_LENGTH, indirect=True)
def test_it_is_analysed_at_length(job: Path, command: str, options: tuple[object, ...]) -> None:
    """These take seconds: by default of one kind that touches and of one that is seen."""
    analysed(job, command, *options)
