"""How often `check` is wrong, and what it finds: many sound and many changed checks of every kind.

    python benchmarks/check_study.py                       # false alarms, 500 checks of each kind
    python benchmarks/check_study.py --kinds range plane --checks 100
    python benchmarks/check_study.py --arm plays --outliers  # an arm with errors that no model has
    python benchmarks/check_study.py --arm bent              # dimensions that the job holds are off
    python benchmarks/check_study.py --keep counted.jsonl  # goes on where it was interrupted
    python benchmarks/check_study.py --keep counted.jsonl --table  # docs/guides/check_table.md
    python benchmarks/check_study.py --found               # what is found, and what it is called

Every calibration has an arm, noise and rows of its own; twenty checks follow each.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from scipy.stats import binom

from suta_calib import CalibrationJob, SolverOptions, simulate, solve
from suta_calib.arrays import FloatArray
from suta_calib.check import Check, Checker
from suta_calib.simulation import read_simulation, write_simulation
from suta_calib.terms import Term

ROOT: Final = Path(__file__).resolve().parents[1]
SUTA: Final = ROOT / "data" / "suta"
CAMERA: Final = ROOT / "examples" / "camera_on_arm"
PER_CALIBRATION: Final = 20
# What the arm has that its job does not estimate.
ARMS: Final = {
    "modelled": "as modelled",
    "plays": "plays and bends",
    "bent": "dimensions held that are off",
}
TABLE: Final = ROOT / "docs" / "guides" / "check_table.md"

ARM: Final = """\
arm: {{urdf: {urdf}, tip: {tip}}}
seed: {seed}
{posture}
errors:
  - {{select: ["*.offset"], std_deg: 0.3}}
  - {{select: [{lengths}], std_mm: 1}}
{bent}
noise: {{seating_mm: 0.08, seating_deg: 0.05, encoder_deg: 0.002,
  instrument_mm: 0.1, instrument_deg: 0.05{noise}}}
sets:
  calibration: {{kind: {kind}, {fitted}}}
  later: {{kind: {kind}, {later}}}
"""
# Of a machined and assembled arm: axes that do not meet, or not squarely.
BENT: Final = """\
  - {select: ["joint_?.r[xy]"], std_deg: 0.1}
  - {select: ["joint_?.[xy]"], std_mm: 1}
"""
JOB: Final = """\
arm: {{urdf: {urdf}, tip: {tip}}}
parameters:
  - {{select: ["*.offset"], bound_deg: 15}}
  - {{select: [{lengths}], bound_mm: 30}}
observations:
  - {{kind: {kind}, {row}samples: 'calibration/*.csv'}}
validation:
  - {{kind: {kind}, {row}samples: 'later/*.csv'}}
"""


@dataclass(frozen=True)
class Kind:
    """A kind of observation, calibrated and checked.

    Attributes:
        fitted, later: what the simulation measures.
        row: what the job's row says.
        label: column whose values are a check each; empty for as many rows as follow.
        rows: of one check.
        camera: whether it is a camera's arm.
        beside: the file that the samples have beside them.
        noise: more than all kinds have.
        within: how far it sees, m: a plane may be looked at along itself.
    """

    fitted: str
    later: str
    row: str = ""
    label: str = ""
    rows: int = 10
    camera: bool = False
    beside: str = ""
    noise: str = ""
    within: float = math.inf


def _places(name: str, first: str, count: int, *, turned: bool, seed: int = 0) -> str:
    random = np.random.default_rng([seed, count])
    stated = []
    for k in range(count):
        angle = random.uniform(-math.pi, math.pi)
        radius, height = random.uniform(420, 500), random.uniform(-50, 50)
        turn = f", rotation_rpy_deg: [0, {random.uniform(0, 10):.1f}, {math.degrees(angle):.1f}]"
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        here = f"position_mm: [{x:.1f}, {y:.1f}, {height:.1f}]{turn if turned else ''}"
        stated.append(f"{first}{k}: {{{here}}}")
    return f"{name}: {{{', '.join(stated)}}}"


_ARTEFACT: Final = f"artefact: {SUTA / 'artefact.yaml'}, "
_INSTRUMENT: Final = (
    "base_in_instrument: {position_mm: [1500, 200, -300], rotation_rpy_deg: [5, -10, 130]}"
)
_EYES: Final = (
    "eye_in_tip: {position_mm: [20, -40, 60], rotation_rpy_deg: [10, 0, 45]}, "
    "target_in_base: {position_mm: [600, 100, -50], rotation_rpy_deg: [180, 0, 20]}"
)
_VIEW: Final = (
    f"board: {CAMERA / 'board.yaml'}, camera: {CAMERA / 'camera.yaml'}, "
    "camera_pose: {position_mm: [30, -60, 40], rotation_rpy_deg: [2, -3, 90]}, "
    "board_pose: {position_mm: [450, 0, 10], rotation_rpy_deg: [0.5, -0.5, 20]}"
)
_POINTS: Final = (
    f"board: {CAMERA / 'board.yaml'}, "
    "camera_pose: {position_mm: [30, -60, 40], rotation_rpy_deg: [2, -3, 90]}, "
    "board_pose: {position_mm: [450, 0, 10], rotation_rpy_deg: [0.5, -0.5, 20]}"
)
_PROBED: Final = "size_mm: 100, probe_radius_mm: 5"
_AXIS: Final = "axis: [0, 0, -1]"
_SCANNED: Final = (
    "plane: true, points: 20, scanner_in_tip: {position_mm: [20, -30, 40], "
    "rotation_rpy_deg: [5, 10, 90]}, "
    "target_in_base: {position_mm: [350, 100, -100], rotation_rpy_deg: [10, 0, 20]}"
)
_WALLS: Final = (
    "camera_pose: {position_mm: [20, -50, 80], rotation_rpy_deg: [5, 10, 40]}, planes: {"
    "A: {position_mm: [0, 0, -200]}, "
    "B: {position_mm: [900, 0, 0], rotation_rpy_deg: [0, -80, 10]}, "
    "C: {position_mm: [0, 900, 0], rotation_rpy_deg: [85, 5, 0]}}"
)
_LATER_PLANES: Final = _places("planes", "V", PER_CALIBRATION, turned=True, seed=1)
_LATER_LINES: Final = _places("lines", "V", PER_CALIBRATION, turned=True, seed=1)
KINDS: Final = {
    "tracked_point": Kind(f"samples: 60, {_INSTRUMENT}", f"samples: 200, {_INSTRUMENT}"),
    "pairwise_distance": Kind(
        _ARTEFACT + _places("placements", "P", 6, turned=True),
        _ARTEFACT + _places("placements", "V", PER_CALIBRATION, turned=True, seed=1),
        _ARTEFACT,
        "placement",
    ),
    "landmark": Kind(
        _ARTEFACT + _places("placements", "P", 6, turned=True),
        _ARTEFACT + _places("placements", "V", PER_CALIBRATION, turned=True, seed=1),
        _ARTEFACT,
        "placement",
    ),
    "fixed_point": Kind(
        f"directions: 25, {_AXIS}, {_places('points', 'P', 4, turned=False)}",
        f"directions: 12, {_AXIS}, {_places('points', 'V', PER_CALIBRATION, turned=False, seed=1)}",
        "",
        "point",
    ),
    "contact": Kind(
        f"directions: 25, {_AXIS}, {_places('spots', 'P', 4, turned=False)}",
        f"directions: 12, {_AXIS}, {_places('spots', 'V', PER_CALIBRATION, turned=False, seed=1)}",
        "",
        "spot",
    ),
    "plane": Kind(
        f"directions: 25, {_PROBED}, {_places('planes', 'P', 5, turned=True)}",
        f"directions: 12, {_PROBED}, {_LATER_PLANES}",
        "probe_radius_mm: 5, ",
        "plane",
    ),
    "line": Kind(
        f"directions: 25, size_mm: 100, {_places('lines', 'P', 5, turned=True)}",
        f"directions: 12, size_mm: 100, {_LATER_LINES}",
        "",
        "line",
    ),
    "range": Kind(
        f"directions: 40, length_mm: [200, 400], {_places('anchors', 'A', 4, turned=False)}",
        f"directions: 55, length_mm: [200, 400], {_places('anchors', 'A', 4, turned=False)}",
    ),
    "hand_eye": Kind(f"samples: 50, {_EYES}", f"samples: 120, {_EYES}", rows=6),
    "gravity": Kind(
        "samples: 60, sensor: {rotation_rpy_deg: [0.3, -0.2, 0.4]}",
        "samples: 200, sensor: {rotation_rpy_deg: [0.3, -0.2, 0.4]}",
    ),
    "camera_view": Kind(
        f"samples: 25, {_VIEW}",
        f"samples: 100, {_VIEW}",
        f"board: {CAMERA / 'board.yaml'}, camera: {CAMERA / 'camera.yaml'}, ",
        rows=5,
        camera=True,
        beside="corners",
        noise=", corner_px: 0.1",
    ),
    "points": Kind(
        f"samples: 60, {_POINTS}",
        f"samples: 200, {_POINTS}",
        f"board: {CAMERA / 'board.yaml'}, ",
        camera=True,
    ),
    "plane_view": Kind(f"samples: 40, {_WALLS}", f"samples: 120, {_WALLS}", rows=8, within=1.5),
    "profile": Kind(
        f"samples: 30, {_SCANNED}",
        f"samples: 100, {_SCANNED}",
        "plane: true, ",
        rows=5,
        beside="profiles",
    ),
}


@dataclass(frozen=True, eq=False)
class Made:
    """A calibration, and the rows of later days.

    Attributes:
        checker: of the calibration.
        checks: rows of each check.
    """

    checker: Checker
    checks: Sequence[Term]


@cache
def made(name: str, seed: int, arm: str = "modelled") -> Made:
    """A calibration with its own truth and noise."""
    kind, random = KINDS[name], np.random.default_rng(seed)
    words = {
        "urdf": CAMERA / "arm.urdf" if kind.camera else ROOT / "urdf" / "suta.urdf",
        "tip": "hand" if kind.camera else "tip",
        "lengths": "joint_3.z, joint_5.z" if kind.camera else "joint_2.z, joint_4.z, joint_6.z",
        "posture": "posture_deg: {joint_2: 20, joint_3: 60, joint_5: 100}" if kind.camera else "",
        "noise": kind.noise,
        "bent": BENT if arm == "bent" else "",
        "kind": name,
        "seed": seed,
    }
    with TemporaryDirectory() as place:
        folder = Path(place)
        file = folder / "simulation.yaml"
        file.write_text(ARM.format(**words, fitted=kind.fitted, later=kind.later))
        write_simulation(simulate(read_simulation(file)), folder)
        text = JOB.format(**words, row=kind.row)
        if kind.beside:
            of_set = [part.partition("/*.csv")[0] for part in text.split("samples: '")[1:]]
            for one in of_set:
                given = f"{kind.beside}: {kind.beside}/{one}.csv, samples: '{one}/"
                text = text.replace(f"samples: '{one}/", given)
        (folder / "job.yaml").write_text(text)
        job = CalibrationJob.load(folder / "job.yaml")
    (later,) = job.validation
    observations = tuple(seen_within(term, kind.within) for term in job.observations)
    later = seen_within(later, kind.within)
    if arm == "plays":
        observations = tuple(with_lack_of_fit(term, random) for term in observations)
        later = with_lack_of_fit(later, random)
    job = replace(job, observations=observations)
    solution = solve(job.problem(), SolverOptions(starts=1))
    if kind.label:
        labels = later.poses.samples.labels[kind.label]
        groups = [np.flatnonzero(labels == one) for one in dict.fromkeys(labels.tolist())]
    else:
        order = random.permutation(len(later.poses))
        groups = [order[k * kind.rows : (k + 1) * kind.rows] for k in range(PER_CALIBRATION)]
    return Made(Checker(solution), [later.take(np.sort(rows)) for rows in groups])


def seen_within(term: Term, reach: float) -> Term:
    """The rows of what was nearer than that."""
    position = term.poses.samples.position
    if position is None or not math.isfinite(reach):
        return term
    return term.take(np.flatnonzero(np.linalg.norm(position, axis=1) < reach))


def with_lack_of_fit(term: Term, random: np.random.Generator) -> Term:
    """Readings of an arm whose joints lag behind, and yield by where the arm reaches."""
    samples = term.poses.samples
    lag = math.radians(0.02) * random.choice([-1.0, 1.0], samples.q.shape)
    yields = np.zeros(samples.q.shape)
    yields[:, 1] = math.radians(0.05) * np.cos(samples.q[:, 1])
    yields[:, 2] = math.radians(0.03) * np.cos(samples.q[:, 1] + samples.q[:, 2])
    return term.over_poses(term.poses.with_samples(replace(samples, q=samples.q + lag + yields)))


def with_outlier(term: Term, random: np.random.Generator) -> Term:
    """One reading of one joint is wrong by half a degree to a degree."""
    samples = term.poses.samples
    q = samples.q.copy()
    row, joint = random.integers(len(q)), random.integers(1, min(4, q.shape[1]))
    q[row, joint] += math.radians(random.uniform(0.5, 1.0)) * random.choice([-1.0, 1.0])
    return term.over_poses(term.poses.with_samples(replace(samples, q=q)))


def sound_checks(
    name: str, count: int, arm: str = "modelled", *, outliers: bool = False
) -> Iterator[Check]:
    """Checks of arms on which nothing changed."""
    done, seed = 0, 0
    while done < count:
        seed += 1
        for check in checks_of(name, seed, arm, outliers=outliers)[: count - done]:
            yield check
            done += 1


def checks_of(name: str, seed: int, arm: str, *, outliers: bool) -> list[Check]:
    """Those of one calibration; none where it did not converge."""
    random, answer = np.random.default_rng([7, seed]), made(name, seed, arm)
    if not answer.checker.solution.converged:
        return []
    rows = [with_outlier(term, random) if outliers else term for term in answer.checks]
    return [answer.checker.check(term) for term in rows]


@dataclass(frozen=True)
class Counted:
    """The checks of one calibration.

    Attributes:
        kind: of observation.
        arm: one of `ARMS`.
        outliers: whether rows are wrong.
        seed: of the calibration.
        p: of each check.
        changed: what each said to have changed.
        bad: of how many rows were called bad.
    """

    kind: str
    arm: str
    outliers: bool
    seed: int
    p: list[float]
    changed: list[list[str]]
    bad: int

    @classmethod
    def of(cls, name: str, seed: int, arm: str, *, outliers: bool) -> Counted:
        """Checks, done now."""
        checks = checks_of(name, seed, arm, outliers=outliers)
        return cls(
            *(name, arm, outliers, seed),
            [check.p for check in checks],
            [[change.what for change in check.changed] for check in checks],
            sum(bool(check.bad_rows) for check in checks),
        )


def counted_in(file: Path | None) -> list[Counted]:
    """What was counted before."""
    if file is None or not file.is_file():
        return []
    return [Counted(**json.loads(line)) for line in file.read_text().splitlines()]


def interval(found: int, count: int) -> tuple[float, float]:
    """95 % interval of a rate (Clopper and Pearson 1934, doi:10.1093/biomet/26.4.404)."""
    rates = np.linspace(0.0, 1.0, 20001)
    low = rates[np.argmax(binom.sf(found - 1, count, rates) > 0.025)] if found else 0.0
    high = rates[np.argmax(binom.cdf(found, count, rates) < 0.025)] if found < count else 1.0
    return float(low), float(high)


def false_alarms(args: argparse.Namespace) -> None:
    """A line for each kind."""
    before = counted_in(args.keep)
    for name in args.kinds:
        mine = [c for c in before if _cell(c) == (name, args.arm, args.outliers)]
        seed = max((c.seed for c in mine), default=0)
        while sum(len(c.p) for c in mine) < args.checks:
            seed += 1
            new = Counted.of(name, seed, args.arm, outliers=args.outliers)
            mine.append(new)
            if args.keep:
                with args.keep.open("a") as kept:
                    kept.write(json.dumps(asdict(new)) + "\n")
        print(" | ".join(_row(name, mine)), dict(_named(mine)), flush=True)


def _cell(counted: Counted) -> tuple[str, str, bool]:
    return counted.kind, counted.arm, counted.outliers


def _named(counted: Sequence[Counted]) -> Counter[str]:
    return Counter(what for c in counted for changed in c.changed for what in changed)


def _row(name: str, counted: Sequence[Counted]) -> list[str]:
    """Checks, calibrations, false alarms, and p-values below 5 %."""
    p = np.array([p for c in counted for p in c.p])
    wrong = sum(bool(changed) for c in counted for changed in c.changed)
    low, high = interval(wrong, len(p))
    return [
        name,
        str(len(p)),
        str(sum(bool(c.p) for c in counted)),
        f"{100 * wrong / len(p):.1f} ({100 * low:.1f} to {100 * high:.1f})",
        f"{100 * np.mean(p < 0.05):.1f}",
        str(sum(c.bad for c in counted)),
    ]


def write_table(args: argparse.Namespace) -> None:
    """`TABLE`, of what was counted."""
    before = counted_in(args.keep)
    lines = [
        "*Simulated; `python benchmarks/check_study.py --keep FILE` counts, and with `--table` it "
        "writes this table. "
        "1 % was asked for.*",
        "",
        "| kind | arm | checks | calibrations | false alarms, % (95 %) | p < 5 % | bad rows |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for name in KINDS:
        for arm, outliers in product(ARMS, (False, True)):
            mine = [c for c in before if _cell(c) == (name, arm, outliers)]
            if any(c.p for c in mine):
                kind, *numbers = _row(name, mine)
                called = ARMS[arm] + ", one wrong row" * outliers
                lines.append(f"| {' | '.join([kind, called, *numbers])} |")
    TABLE.write_text("\n".join(lines) + "\n")


def with_joint_off(term: Term, joint: int, angle: float) -> Term:
    """All rows of an arm of which one joint reads too much."""
    samples = term.poses.samples
    q = samples.q.copy()
    q[:, joint] += angle
    return term.over_poses(term.poses.with_samples(replace(samples, q=q)))


def with_camera_moved(term: Term, values: dict[str, float], by: FloatArray) -> Term:
    """What a camera would have seen that was shifted, m, and turned, rad, in its own place."""
    moved = dict(values)
    for key, change in zip(("x", "y", "z", "rx", "ry", "rz"), by.tolist(), strict=True):
        moved[f"hand_eye.{key}"] += change
    before, after = (term.observed(v, term.poses) for v in (values, moved))
    samples = term.poses.samples
    if samples.pixels is not None:
        assert before.pixels is not None
        assert after.pixels is not None
        seen = replace(samples, pixels=samples.pixels + after.pixels - before.pixels)
    else:
        assert samples.position is not None
        assert before.position is not None
        assert before.rotation is not None
        assert after.position is not None
        assert after.rotation is not None
        assert samples.rotation is not None
        position = samples.position + after.position - before.position
        turned = np.swapaxes(before.rotation, 1, 2) @ after.rotation
        seen = replace(samples, position=position, rotation=samples.rotation @ turned)
    return term.over_poses(term.poses.with_samples(seen))


def found(count: int) -> None:
    """What of a change is found, and what it is called."""
    random = np.random.default_rng(3)
    # Pictures, of a real camera and as poses of a target.
    pictures = 5
    for name in ("camera_view", "hand_eye"):
        for what, size in (("1 mm", 1e-3), ("0.1°", math.radians(0.1))):
            seen = called = 0
            for k in range(count):
                answer = made(name, 1 + k // PER_CALIBRATION)
                term = answer.checks[k % PER_CALIBRATION].take(np.arange(pictures))
                direction = random.standard_normal(3)
                by = np.zeros(6)
                first = 0 if what.endswith("mm") else 3
                by[first : first + 3] = size * direction / np.linalg.norm(direction)
                values = answer.checker.solution.values
                check = answer.checker.check(with_camera_moved(term, values, by))
                seen += not check.unchanged
                named = [n for c in check.changed for n in (c.what, *c.instead)]
                called += "camera" in named
            print(
                f"{name}: camera moved by {what}, {pictures} pictures: found {seen} of {count}, "
                f"camera named {called}",
                flush=True,
            )
    seen = called = first_called = 0
    for k in range(count):
        answer = made("tracked_point", 1 + k // PER_CALIBRATION)
        joint = k % 6
        angle = math.radians(0.1) * random.choice([-1.0, 1.0])
        check = answer.checker.check(
            with_joint_off(answer.checks[k % PER_CALIBRATION], joint, angle)
        )
        seen += not check.unchanged
        name = f"joint joint_{joint + 1}"
        first_called += bool(check.changed) and check.changed[0].what == name
        called += any(name in (c.what, *c.instead) for c in check.changed)
    print(
        f"tracked_point: a joint off by 0.1°, 10 touches: found {seen} of {count}, named first "
        f"{first_called}, named {called}",
        flush=True,
    )


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--kinds", nargs="+", default=[*KINDS], choices=[*KINDS])
    parser.add_argument("--checks", type=int, default=500)
    parser.add_argument("--arm", default="modelled", choices=[*ARMS])
    parser.add_argument("--outliers", action="store_true")
    parser.add_argument("--found", action="store_true")
    parser.add_argument("--keep", type=Path, help="file of what was counted, which is added to")
    parser.add_argument("--table", action="store_true", help="write the table of what was counted")
    args = parser.parse_args()
    if args.found:
        found(args.checks)
    elif args.table:
        write_table(args)
    else:
        false_alarms(args)


if __name__ == "__main__":
    main()
