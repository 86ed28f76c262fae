"""False alarms of the whole judgement, counted over sound jobs and poses of every kind. Simulated.

``python benchmarks/false_alarms.py [--seeds N] [--processes N] [--json FILE]``

A job is a kind of observation, with and without orientations, with bounds or with priors, and a
seed: the arm is off by 1 mm and 3 mrad (standard deviation) per parameter, the noise is what the
fit may learn. An alarm is a verdict that is not *good* for another reason than parameters that
such data leave open. Writes ``results/false_alarms.md``.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import track
from scipy.spatial.transform import Rotation
from scipy.special import betaincinv

from suta_calib import calibrate_hand_eye, calibrate_pivot, register
from suta_calib.terms import EyeSetup

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results" / "false_alarms.md"
# The scenes of the tests are the sound jobs.
sys.path.insert(0, str(ROOT / "tests" / "support"))
from clean_jobs import (  # noqa: E402
    MIXED,
    SORTS,
    as_init_frees,
    judged,
    judged_chains,
    with_priors,
)
from pose_scenes import pair_numbers, pivot_numbers, point_numbers  # noqa: E402
from simulated import arm_named  # noqa: E402


class Case(NamedTuple):
    """One sound job: of an arm (kind, orientations, what is unknown), a robot, or on poses."""

    kind: str
    oriented: bool
    unknown: str
    seed: int


class Outcome(NamedTuple):
    """What was said of a sound job."""

    case: Case
    level: str
    notes: tuple[str, ...]

    @property
    def alarm(self) -> bool:
        """Whether something is said against sound data.

        That a parameter is held, because touches on planes and points have no scale, is true.
        """
        false = [note for note in self.notes if "URDF value" not in note]
        return self.level == "bad" or (self.level == "care" and bool(false))


def cases(seeds: int) -> Iterator[Case]:
    """Every kind with every seed, kinds mixed over chains, and the answers on poses."""
    for seed in range(seeds):
        for kind, oriented in SORTS:
            for unknown in ("bounds", "priors"):
                yield Case(kind, oriented, unknown, seed)
        for mixed in MIXED:
            yield Case(f"robot: {mixed}", True, "chains", seed)
        for command in ("pivot", "hand-eye in hand", "hand-eye to hand", "register"):
            yield Case(command, True, "poses", seed)


def outcome(case: Case) -> Outcome:
    """Calibrate one sound job and say what the judgement is."""
    warnings.simplefilter("ignore")
    of = {"poses": on_poses, "chains": of_chains}.get(case.unknown, of_arm)
    found = of(case)
    return Outcome(case, found[0], found[1])


def of_arm(case: Case) -> tuple[str, tuple[str, ...]]:
    """Verdict and notes of a job of an arm."""
    arm = arm_named("suta")
    unknown = as_init_frees(arm) if case.unknown == "bounds" else with_priors(arm)
    verdict = judged(arm, unknown, case.kind, case.oriented, case.seed)
    return verdict.level, tuple(verdict.notes)


def of_chains(case: Case) -> tuple[str, tuple[str, ...]]:
    """Verdict and notes of a job of several chains of one robot."""
    verdict = judged_chains(MIXED[case.kind.removeprefix("robot: ")], case.seed)
    return verdict.level, tuple(verdict.notes)


def on_poses(case: Case) -> tuple[str, tuple[str, ...]]:
    """Verdict and notes of poses."""

    def matrices(quaternions: np.ndarray) -> np.ndarray:
        return Rotation.from_quat(quaternions).as_matrix()

    if case.kind == "pivot":
        rows = pivot_numbers(["left"] * 30, case.seed)
        verdict = calibrate_pivot(matrices(rows[:, 3:]), rows[:, :3]).assessment
    elif case.kind == "register":
        verdict = register(*point_numbers(12, case.seed)).assessment
    else:
        setup: EyeSetup = "eye-in-hand" if case.kind.endswith("in hand") else "eye-to-hand"
        rows = pair_numbers(25, setup, case.seed)
        hand, seen = ((matrices(rows[:, k + 3 : k + 7]), rows[:, k : k + 3]) for k in (0, 7))
        verdict = calibrate_hand_eye(hand, seen, setup=setup).assessment
    return verdict.level, tuple(verdict.notes)


def page(outcomes: Sequence[Outcome]) -> str:
    """A table: kind, sound jobs, alarms, and the upper end of the 95 % interval of their rate."""
    rows: dict[str, list[Outcome]] = defaultdict(list)
    for one in outcomes:
        rows[one.case.kind].append(one)
    lines = [
        "# False alarms over sound simulated jobs",
        "",
        "`python benchmarks/false_alarms.py` writes this page. An alarm is any verdict but *good*,",
        "unless it is care for nothing but parameters that such data leave open. *robot* is one",
        "job of several chains that share joints, each with a kind of its own. The last column is",
        "the upper end of the rate (Clopper and Pearson 1934, 95 %, one-sided).",
        "",
        "| kind | jobs | alarms | rate below |",
        "|---|--:|--:|--:|",
    ]
    for kind, found in [*sorted(rows.items()), ("all", list(outcomes))]:
        jobs, alarms = len(found), sum(one.alarm for one in found)
        upper = 1.0 if alarms == jobs else float(betaincinv(alarms + 1, jobs - alarms, 0.95))
        lines.append(f"| {kind} | {jobs} | {alarms} | {100 * upper:.1f} % |")
    wrong = [one for one in outcomes if one.alarm]
    if wrong:
        lines += ["", "What the alarms say:", ""]
        lines += [
            f"* {one.case.kind}, {one.case.unknown}, seed {one.case.seed}: {' '.join(one.notes)}"
            for one in wrong
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run every case, write the page, print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, help="every outcome, as JSON")
    options = parser.parse_args()
    todo = list(cases(options.seeds))
    work = Parallel(n_jobs=options.processes, return_as="generator")(
        delayed(outcome)(case) for case in todo
    )
    outcomes = list(track(work, "sound jobs", total=len(todo), console=Console(stderr=True)))
    if options.json:
        options.json.write_text(json.dumps([[*one.case, one.level, one.notes] for one in outcomes]))
    RESULTS.write_text(page(outcomes), encoding="utf-8")
    print(page(outcomes))


if __name__ == "__main__":
    main()
