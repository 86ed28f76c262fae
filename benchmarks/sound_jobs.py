"""Jobs of which the truth is known: the shipped ones, and one of every kind of observation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from what_goes_wrong import Corruption
from wrong_samples import URDF

from suta_calib import Samples, simulate
from suta_calib.simulation import Simulation, read_simulation

SUTA: Final = Path(__file__).resolve().parents[1] / "data" / "suta"

SIMULATION: Final = """\
arm: {{urdf: {urdf}, tip: tip}}
seed: 1
posture_deg: {{joint_1: 15, joint_2: 175, joint_3: 160, joint_4: 110, joint_5: -90, joint_6: -125}}
errors:
  - {{select: ["*.offset"], std_deg: 0.5}}
  - {{select: [joint_2.z, joint_4.z, joint_6.z, tip.y], std_mm: 1}}
noise:
  {{seating_mm: 0.1, seating_deg: 0.05, encoder_deg: 0.001,
    instrument_mm: 0.1, instrument_deg: 0.05}}
sets:
  calibration: {{kind: {kind}, {fitted}}}
  validation: {{kind: {kind}, {held_out}}}
"""
JOB: Final = """\
arm: {{urdf: {urdf}, tip: tip}}
parameters:
{parameters}observations: [{{kind: {kind}, {row}samples: calibration/*.csv}}]
validation: [{{kind: {kind}, {row}samples: validation/*.csv}}]
solver: {{starts: {starts}}}
"""
PARAMETERS: Final = {
    "bounds": '  - {select: ["*.offset"], bound_deg: 15}\n'
    "  - {select: [joint_2.z, joint_4.z, joint_6.z, tip.y], bound_mm: 30}\n",
    "priors": "  - {select: geometric, prior_mm: 1, prior_deg: 0.2}\n"
    '  - {select: ["*.offset"], prior_deg: 0.75}\n',
}


def places(name: str, first: str, *rows: tuple[float, float, float, float]) -> str:
    """Places ``A1, A2, …`` at x, y, z, mm, and, but for points, some tilt and a yaw, deg."""
    stated = []
    for k, (x, y, z, yaw) in enumerate(rows):
        turned = "" if name == "points" else f", rotation_rpy_deg: [0, {8 * k}, {yaw}]"
        stated.append(f"{first}{k + 1}: {{position_mm: [{x}, {y}, {z}]{turned}}}")
    return f"{name}: {{{', '.join(stated)}}}"


PUT_DOWN: Final = (
    (512.5, 12.5, 0, -105), (462.5, -37.5, 0, 15), (462.5, 62.5, 0, 30), (512.5, 112.5, 0, 30)
)  # fmt: skip
PUT_DOWN_LATER: Final = (437.5, -12.5, 0, -90), (487.5, 37.5, 0, -105)
TWICE: Final = f"artefact: {SUTA / 'artefact.yaml'}, repeats: 2"
# By kind: what the two sets say, and what the job's rows say.
KINDS: Final = {
    **{
        kind: (
            f"{TWICE}, {places('placements', 'P', *PUT_DOWN)}",
            f"{TWICE}, {places('placements', 'V', *PUT_DOWN_LATER)}",
            "artefact: artefact.yaml, ",
        )
        for kind in ("pairwise_distance", "landmark")
    },
    "fixed_point": (
        f"directions: 30, axis: [0, 0, -1], {places('points', 'P', *PUT_DOWN)}",
        f"directions: 25, axis: [0, 0, -1], {places('points', 'V', *PUT_DOWN_LATER)}",
        "",
    ),
    "plane": (
        f"directions: 30, size_mm: 100, probe_radius_mm: 5, {places('planes', 'P', *PUT_DOWN)}",
        f"directions: 25, probe_radius_mm: 5, {places('planes', 'V', *PUT_DOWN_LATER)}",
        "probe_radius_mm: 5, ",
    ),
    **{
        kind: (f"samples: 60, {frames}", f"samples: 40, {frames}", "")
        for kind, frames in (
            (
                "tracked_point",
                "orientation: true, base_in_instrument: "
                "{position_mm: [1500, 200, -300], rotation_rpy_deg: [5, -10, 130]}",
            ),
            (
                "hand_eye",
                "eye_in_tip: {position_mm: [20, -40, 60], rotation_rpy_deg: [10, 0, 45]}, "
                "target_in_base: {position_mm: [600, 100, -50], rotation_rpy_deg: [180, 0, 20]}",
            ),
        )
    },
}


@dataclass(frozen=True)
class Sound:
    """A job before anything goes wrong.

    Attributes:
        name, text: of the job.
        made: what was measured for it.
        says: words of what is rightly said against it.
    """

    name: str
    text: str
    made: Simulation
    says: str | None = None

    @property
    def samples(self) -> dict[str, Samples]:
        """By file; ``calibration/P1.csv``."""
        return {file.path: file.samples for file in self.made.files}

    def suffers(self, corruption: Corruption) -> bool:
        """Whether it can happen to this job."""
        if corruption.needs == "artefact":
            return "artefact:" in self.text
        return any(has(samples, corruption.needs) for samples in self.samples.values())


def has(samples: Samples, needed: str) -> bool:
    """Whether samples have what a corruption needs."""
    if needed == "order":  # in which rows were seen, or landmarks were touched
        return samples.position is not None or "landmark" in samples.labels
    if needed == "touches":
        return samples.position is None
    if needed in ("position", "rotation"):
        return getattr(samples, needed) is not None
    return needed in ("", "artefact", *samples.labels)


def sound_jobs(
    kinds: Iterable[str] = KINDS, *, shipped: bool = True, starts: int = 4
) -> Iterator[Sound]:
    """The shipped jobs, and one of every kind with bounds and one with priors."""
    if shipped:
        made = simulate(read_simulation(SUTA / "simulation.yaml"))
        for name in ("calibration", "calibration_full"):
            text = (SUTA / f"{name}.yaml").read_text().replace("../../urdf/suta.urdf", str(URDF))
            text = text.replace("starts: 8", f"starts: {starts}")
            used = tuple(file for file in made.files if file.path.split("/")[0] in text)
            # The thesis frees less than is wrong of the arm.
            says = "times the scatter of repeats" if name == "calibration" else None
            yield Sound(name, text, replace(made, files=used), says)
    for kind in kinds:
        fitted, held_out, row = KINDS[kind]
        with TemporaryDirectory() as folder:
            file = Path(folder) / "simulation.yaml"
            sets = {"kind": kind, "fitted": fitted, "held_out": held_out}
            file.write_text(SIMULATION.format(urdf=URDF, **sets))
            made = simulate(read_simulation(file))
        for what, parameters in PARAMETERS.items():
            rows = {"kind": kind, "row": row, "parameters": parameters, "starts": starts}
            yield Sound(f"{kind}, {what}", JOB.format(urdf=URDF, **rows), made)
