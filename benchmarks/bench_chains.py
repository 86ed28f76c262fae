"""Two arms on one torso in one job: time of the whole answer, and memory by rows.

Each size runs in a process of its own. The answer is `calibrate` with rows that are not fitted, and
its verdict; reading modules is left out. Of 60 unknowns and 1,000 poses it must take 2 s of
processor time at most, and from 4,000 to 16,000 rows memory must grow by no more than rows do.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Final

import numpy as np
from rich.console import Console
from tables import number_table

from suta_calib import Selection, calibrate

ROOT: Final = Path(__file__).parents[1]
# The two arms of the tests.
sys.path.insert(0, str(ROOT))
from tests.support.torso_robot import built, torso_robot, tracked  # noqa: E402

SIZES: Final = (1_000, 4_000, 16_000)
SECONDS: Final = 2.0
# Memory per row from 4,000 rows on over that from 1,000 to 4,000: 1 is linear.
GROWTH: Final = 1.25
# 60 unknowns: the zero of every joint, where every joint is, and where every axis points to.
FREE: Final = ("*.offset", "*.x", "*.y", "left_[123].r[xy]", "right_[123].r[xy]", "torso_?.r[xyz]")


def peak_mb() -> float:
    """Most memory that this process had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def answer(rows: int) -> dict[str, float]:
    """Time and memory of one size."""
    rng, robot = np.random.default_rng(0), torso_robot()
    geometry = robot.select(Selection(FREE, prior_m=2e-3, prior_rad=9e-3))
    truth = {n: v for n, v in built(robot, rng).items() if n in geometry}
    each = rows // 2
    fitted, held_out = (
        [tracked(arm, truth, n, rng) for arm in robot.chains.values()] for n in (each, each // 5)
    )
    before, began = peak_mb(), process_time()
    result = calibrate(
        robot, fitted, validation=held_out, free=[Selection(FREE, prior_m=2e-3, prior_rad=9e-3)]
    )
    level = result.assessment.level
    seconds = process_time() - began
    if level == "bad":
        raise SystemExit(f"{rows} rows: {result.assessment.sentence}")
    unknowns = sum(k < result.solution.problem.arm_count for k in result.solution.free.tolist())
    return {
        "rows": rows,
        "unknowns": unknowns,
        "seconds": seconds,
        "before": before,
        "peak": peak_mb(),
    }


def main() -> None:
    """Run every size, print the table, and fail where a limit is passed."""
    if len(sys.argv) > 1:
        print(json.dumps(answer(int(sys.argv[1]))))
        return
    found = []
    for size in SIZES:
        ran = subprocess.run(
            [sys.executable, __file__, str(size)], capture_output=True, text=True, check=False
        )
        if ran.returncode:
            raise SystemExit(ran.stderr)
        found.append(json.loads(ran.stdout.splitlines()[-1]))
    columns = ("rows", "unknowns of the arms", "answer, s", "peak, MB", "kB per row more")
    table = number_table("Two arms on one torso, one job", *columns)
    slopes = ["–"]
    slopes += [
        f"{1024 * (b['peak'] - a['peak']) / (b['rows'] - a['rows']):.1f}"
        for a, b in pairwise(found)
    ]
    for one, slope in zip(found, slopes, strict=True):
        numbers = f"{one['seconds']:.2f}", f"{one['peak']:.0f}", slope
        table.add_row(f"{one['rows']:,}", str(one["unknowns"]), *numbers)
    Console(width=100).print(table)
    if found[0]["seconds"] > SECONDS:
        raise SystemExit(f"{SIZES[0]:,} rows took {found[0]['seconds']:.1f} s, over {SECONDS} s")
    if slopes[-1] > GROWTH * slopes[1]:
        raise SystemExit("memory grows faster than the rows")


if __name__ == "__main__":
    main()
