"""What each kind of observation tells of one arm: `python docs/figures/which_observation.py`.

Sixty samples of every kind alone are simulated, all with the same noise, and `suta-calib observe`
says what they can determine. Writes the table of `docs/guides/which_observation.md`.
"""

from __future__ import annotations

import io
import json
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

from suta_calib.cli._app import run
from suta_calib.measurements import write_text
from suta_calib.registry import shipped
from suta_calib.terms import KINDS
from suta_calib.units import deg, mm

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "docs" / "guides" / "which_observation_table.md"
ARM = f"arm: {{urdf: {ROOT / 'urdf' / 'suta.urdf'}, tip: tip}}\n"
# Six offsets and seven lengths, as in data/suta/calibration.yaml.
UNKNOWNS = """\
parameters:
  - {select: ["*.offset"], bound_deg: 15}
  - {select: [joint_2.z, joint_4.z, joint_6.z, tip.y, joint_3.z, joint_5.z, tip.z], bound_mm: 30}
"""
NOISE = "noise: {seating_mm: 0.1, instrument_mm: 0.1, instrument_deg: 0.05, corner_px: 0.1}\n"
# Where a hand would hold the arm.
POSTURE = (
    "posture_deg: {joint_1: 15, joint_2: 175, joint_3: 160, joint_4: 110, joint_5: -90, "
    "joint_6: -125}\n"
)
PLACES = """
    {place}s:
      S1: {{position_mm: [400, 50, 0]{turn1}}}
      S2: {{position_mm: [-50, 400, 50]{turn2}}}
      S3: {{position_mm: [-400, -50, 0]{turn3}}}
      S4: {{position_mm: [50, -400, 50]{turn4}}}
    directions: 15
    cone_deg: 40"""
# The same 60 postures for an arm of six joints, which has few of them in one pose.
GRIPS = "\n    directions: 4\n    grips:" + "".join(
    f"\n      S{k}: {{position_mm: [{x}, {y}, {z}], "
    f"rotation_rpy_deg: [{180 - tilt}, {tilt}, {yaw}]}}"
    for k, (x, y, z, tilt, yaw) in enumerate(
        (400 - 25 * k, 30 * k - 200, 10 * (k % 5), 5 * (k % 7) - 15, 40 * k) for k in range(15)
    )
)
TURNS = ("[0, 6, 20]", "[23, 0, 70]", "[-6, -17, 130]", "[28, 17, 50]")
ON_ARTEFACT = f"""
    artefact: {ROOT / "data" / "suta" / "artefact.yaml"}
    placements:
      P1: {{position_mm: [462.5, -37.5, 0], rotation_rpy_deg: [0, 0, 15]}}
      P2: {{position_mm: [462.5, 62.5, 0], rotation_rpy_deg: [0, 0, 30]}}
      P3: {{position_mm: [512.5, 112.5, 0], rotation_rpy_deg: [0, 0, 30]}}
      P4: {{position_mm: [512.5, -87.5, 0], rotation_rpy_deg: [0, 0, -120]}}"""
CAMERA = f"""
    board: {ROOT / "data" / "workcell" / "board.yaml"}
    camera: {ROOT / "data" / "workcell" / "camera.yaml"}"""


def places(place: str, *, turned: bool) -> str:
    """Four places without an artefact, touched from fifteen directions each."""
    turns = {f"turn{k}": f", rotation_rpy_deg: {t}" * turned for k, t in enumerate(TURNS, 1)}
    return PLACES.format(place=place, **turns)


# By kind: its set of the simulation, and what its row of the job names beside the samples.
SCENES = {
    "pairwise_distance": (ON_ARTEFACT, ON_ARTEFACT.splitlines()[1]),
    "landmark": (ON_ARTEFACT, ON_ARTEFACT.splitlines()[1]),
    "fixed_point": (places("point", turned=False), ""),
    "plane": (places("plane", turned=True), ""),
    "line": (places("line", turned=True), ""),
    "range": (places("anchor", turned=False) + "\n    length_mm: [200, 400]", ""),
    "contact": (places("spot", turned=False), ""),
    "closed_loop": (GRIPS, ""),
    "gravity": ("\n    samples: 60", ""),
    "tracked_point": ("\n    samples: 60", ""),
    "hand_eye": (
        "\n    samples: 60\n    eye_in_tip: {position_mm: [20, -50, 80]}"
        "\n    target_in_base: {position_mm: [600, 200, -100]}",
        "",
    ),
    "camera_view": (
        f"\n    samples: 60{CAMERA}\n    camera_pose: {{position_mm: [20, -50, 80]}}"
        "\n    board_pose: {position_mm: [600, 200, -100]}",
        f"{CAMERA}\n    corners: corners/set.csv",
    ),
    "profile": (
        "\n    samples: 60\n    sphere_radius_mm: 40"
        "\n    scanner_in_tip: {position_mm: [20, -50, 80]}"
        "\n    target_in_base: {position_mm: [350, 100, -100]}",
        "\n    sphere_radius_mm: 40\n    profiles: profiles/set.csv",
    ),
    "points": (
        "\n    samples: 60\n    camera_pose: {position_mm: [20, -50, 80]}"
        "\n    points: {A: {position_mm: [600, 200, -100]}}",
        "",
    ),
    "plane_view": (
        "\n    samples: 60\n    camera_pose: {position_mm: [20, -50, 80]}"
        "\n    planes: {A: {position_mm: [0, 0, -200]}, "
        "B: {position_mm: [900, 0, 0], rotation_rpy_deg: [0, 90, 0]}}",
        "",
    ),
}


def main() -> None:
    """Write the table."""
    heads = (
        "| kind alone | of 13 parameters it tells | ± upper arm (`joint_4.z`), mm "
        "| ± elbow (`joint_4.offset`), deg | ± tool (`tip.y`), mm |\n"
        "|---|--:|--:|--:|--:|\n"
    )
    below = (
        "\nSimulated, with 0.1 mm, 0.05° and 0.1 px of noise; – is held. Written by "
        "`python docs/figures/which_observation.py`.\n"
    )
    write_text(TABLE, f"{heads}{''.join(map(row, shipped(KINDS)))}{below}")


def row(kind: str) -> str:
    """The row of one kind."""
    parameters = observed(kind)["parameters"]
    told_of_arm = [
        name
        for name, each in parameters.items()
        if name.startswith(("joint_", "tip.")) and each["std"] is not None
    ]
    figures = (
        "–" if (std := parameters[name]["std"]) is None else f"{shown(std):.3f}"
        for name, shown in (("joint_4.z", mm), ("joint_4.offset", deg), ("tip.y", mm))
    )
    return f"| `{kind}` | {len(told_of_arm)} | {' | '.join(figures)} |\n"


def observed(kind: str) -> dict[str, dict[str, dict[str, float | None]]]:
    """What `suta-calib observe` says of sixty samples of one kind."""
    scene, row = SCENES[kind]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulation, job = folder / "simulation.yaml", folder / "calibration.yaml"
        simulation.write_text(
            f"{ARM}seed: 1\n{POSTURE}{NOISE}sets:\n  set:\n    kind: {kind}{scene}\n", "utf-8"
        )
        unit = KINDS[kind].unit
        sigma = "" if unit == "deg" else f"\n    sigma_{unit}: 0.1"
        sigma += "\n    sigma_deg: 0.05" if KINDS[kind].has_angles else ""
        named = row if not row or row.startswith("\n") else f"\n{row}"
        job.write_text(
            f"{ARM}{UNKNOWNS}observations:\n  - kind: {kind}\n    samples: 'set/*.csv'"
            f"{named}{sigma}\n",
            "utf-8",
        )
        assert run(["simulate", str(simulation), "--out", str(folder)]) == 0
        with redirect_stdout(io.StringIO()) as printed:
            run(["observe", str(job), "--json"])
    answer: dict[str, dict[str, dict[str, float | None]]] = json.loads(printed.getvalue())
    return answer


if __name__ == "__main__":
    main()
