"""Sound jobs, corrupted as it happens in laboratories: refused, warned, or silently wrong?

Every kind of observation over the simulated SUTA, with priors and without, is corrupted in every
way of `suta_calib.simulation.corruption` and calibrated. An answer is *silently wrong* where it is
good (no note at all), but its tip is further off than three times what the clean job's is, after
registration, over postures it never saw. Everything is simulated, so the truth is known.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from suta_calib import CalibrationJob, Problem, assess, solve
from suta_calib.diagnostics.assessment import assess_calibration
from suta_calib.errors import SutaCalibError
from suta_calib.geometry import register_points
from suta_calib.simulation import Simulation, read_simulation, simulate, write_simulation
from suta_calib.simulation.corruption import CORRUPTIONS, Corruption
from suta_calib.simulation.noise import stream

DATA = Path(__file__).parents[1] / "data" / "suta"
SIMULATION = """\
arm: {{urdf: {urdf}, tip: tip}}
seed: 1
posture_deg: {{joint_1: 15, joint_2: 175, joint_3: 160, joint_4: 110, joint_5: -90, joint_6: -125}}
errors:
  - {{select: ["*.offset"], std_deg: 0.5}}
  - {{select: [joint_2.z, joint_4.z, joint_6.z, tip.y], std_mm: 1}}
noise:
  {{seating_mm: 0.1, seating_deg: 0.05, encoder_deg: 0.001, instrument_mm: 0.1, instrument_deg: 0.05}}
sets:
"""
TOUCHED = """\
  {name}: {{kind: {kind}, artefact: {artefact}, repeats: 2, placements: {places}}}
"""
PLACES = (
    "{P1: {position_mm: [512.5, 12.5, 0], rotation_rpy_deg: [0, 0, -105]}, "
    "P2: {position_mm: [462.5, -37.5, 0], rotation_rpy_deg: [0, 0, 15]}, "
    "P3: {position_mm: [462.5, 62.5, 0], rotation_rpy_deg: [0, 0, 30]}, "
    "P4: {position_mm: [512.5, 112.5, 0], rotation_rpy_deg: [0, 0, 30]}}",
    "{V1: {position_mm: [437.5, -12.5, 0], rotation_rpy_deg: [0, 0, -90]}, "
    "V2: {position_mm: [487.5, 37.5, 0], rotation_rpy_deg: [0, 0, -105]}}",
)
SEEN = {
    "tracked_point": "samples: {n}, orientation: true, base_in_instrument: "
    "{{position_mm: [1500, 200, -300], rotation_rpy_deg: [5, -10, 130]}}",
    "hand_eye": "samples: {n}, eye_in_tip: {{position_mm: [20, -40, 60], rotation_rpy_deg: "
    "[10, 0, 45]}}, target_in_base: {{position_mm: [600, 100, -50], rotation_rpy_deg: [180, 0, 20]}}",
}
PARAMETERS = {
    "bounds": '  - {select: ["*.offset"], bound_deg: 15}\n'
    "  - {select: [joint_2.z, joint_4.z, joint_6.z, tip.y], bound_mm: 30}\n",
    "priors": "  - {select: geometric, prior_mm: 1, prior_deg: 0.2}\n"
    '  - {select: ["*.offset"], prior_deg: 0.75}\n',
}
KINDS = ("pairwise_distance", "landmark", "tracked_point", "hand_eye")


@dataclass(frozen=True)
class Outcome:
    """What became of one corrupted job."""

    job: str
    corruption: str
    verdict: str
    named: bool
    error: float
    stated: float
    note: str

    @property
    def silently_wrong(self) -> bool:
        """Good without a word, and wrong."""
        return self.verdict == "good" and self.error > 3 * self.stated


def jobs(folder: Path) -> Iterator[tuple[str, CalibrationJob, Simulation]]:
    """A job of every kind, with bounds and with priors, its samples simulated."""
    for kind in KINDS:
        place = folder / kind
        place.mkdir()
        text = SIMULATION.format(urdf=DATA.parents[1] / "urdf" / "suta.urdf")
        artefact = DATA / "artefact.yaml"
        for name, places, n in zip(("calibration", "validation"), PLACES, (60, 40), strict=True):
            if kind in SEEN:
                text += f"  {name}: {{kind: {kind}, {SEEN[kind].format(n=n)}}}\n"
            else:
                text += TOUCHED.format(name=name, kind=kind, artefact=artefact, places=places)
        (place / "simulation.yaml").write_text(text, encoding="utf-8")
        made = simulate(read_simulation(place / "simulation.yaml"))
        write_simulation(made, place)
        for what, parameters in PARAMETERS.items():
            row = f"kind: {kind}" + ("" if kind in SEEN else f", artefact: {artefact}")
            path = place / f"{what}.yaml"
            path.write_text(
                f"arm: {{urdf: {DATA.parents[1] / 'urdf' / 'suta.urdf'}, tip: tip}}\n"
                f"parameters:\n{parameters}observations:\n"
                f"  - {{{row}, samples: 'calibration/*.csv'}}\nvalidation:\n"
                f"  - {{{row}, samples: 'validation/*.csv'}}\nsolver: {{starts: 4}}\n",
                encoding="utf-8",
            )
            yield f"{kind}, {what}", CalibrationJob.load(path), made


def outcome(
    name: str, job: CalibrationJob, made: Simulation, corruption: Corruption | None, stated: float
) -> Outcome:
    """Calibrate a job whose fitted and held-out samples were corrupted alike."""
    what = "nothing" if corruption is None else corruption.name
    try:
        fitted = list(job.observations) if corruption is None else corruption.of(job.observations)
        held_out = list(job.validation) if corruption is None else corruption.of(job.validation)
        solution = solve(Problem(fitted, job.parameters), replace(job.options(), starts=4))
        assessment = assess_calibration(solution, assess(solution, held_out))
    except SutaCalibError as error:
        return Outcome(name, what, "refused", True, np.nan, stated, str(error))
    said = " ".join((assessment.sentence, *assessment.notes))
    named = corruption is not None and corruption.said in said
    values = {**made.values, **solution.values}
    error = tip_error(made, {k: v for k, v in values.items() if k in made.arm.offered})
    note = next(iter(assessment.notes), "")
    return Outcome(name, what, assessment.level, named, error, stated or error, note)


def tip_error(made: Simulation, values: dict[str, float]) -> float:
    """RMS distance of the tip from the truth after registration, m, over random postures."""
    middle = np.array([row.reading for row in made.spec.posture])
    q = middle + stream(0, "postures").uniform(-0.5, 0.5, (200, len(middle)))
    true, found = made.arm.forward(q, made.values)[1], made.arm.forward(q, values)[1]
    R, p = register_points(found, true)
    return float(np.sqrt(np.mean(np.sum((found @ R.T + p - true) ** 2, axis=1))))


def study(most: int | None = None, progress: bool = True) -> list[Outcome]:
    """Every job with every corruption that can happen to it; the clean job first."""
    found = []
    with TemporaryDirectory() as folder:
        for name, job, made in jobs(Path(folder)):
            clean = outcome(name, job, made, None, 0.0)
            found.append(clean)
            fitting = [c for c in CORRUPTIONS if c.fits(job.observations)][:most]
            for corruption in track(fitting, name, disable=not progress):
                found.append(outcome(name, job, made, corruption, max(clean.error, 1e-4)))
    return found


def main() -> None:
    """Print what became of every job."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=int, help="Only the first so many corruptions.")
    found = study(parser.parse_args().most)
    table = Table(title="corrupted jobs (simulated)")
    for head in ("job", "corruption", "answer", "cause named", "tip error, mm", "first note"):
        table.add_column(head)
    for each in found:
        table.add_row(
            each.job,
            each.corruption,
            "SILENTLY WRONG" if each.silently_wrong else each.verdict,
            "yes" if each.named else "",
            f"{1e3 * each.error:.3f}",
            each.note[:70],
        )
    console = Console(width=190)
    console.print(table)
    corrupted = [each for each in found if each.corruption != "nothing"]
    harmful = [e for e in corrupted if e.verdict == "refused" or e.error > 3 * e.stated]
    counts = Counter(each.verdict for each in corrupted)
    console.print(f"{len(corrupted)} corrupted jobs: {dict(counts)}")
    console.print(
        f"{len(harmful)} harmed: {sum(e.silently_wrong for e in harmful)} silently wrong, cause "
        f"named or refused in {sum(e.named for e in harmful)}"
    )
    clean = Counter(each.verdict for each in found if each.corruption == "nothing")
    console.print(f"clean jobs: {dict(clean)}")


if __name__ == "__main__":
    main()
