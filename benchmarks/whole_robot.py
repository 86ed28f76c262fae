"""Tip errors of both hands of a robot beside what is stated, over many seeds. Simulated.

``python benchmarks/whole_robot.py [--seeds N] [--processes N]``

The robot of ``examples/whole_robot``: a torso of three joints, two arms of seven. Every joint's
origin is 1 mm and 8 mrad off (standard deviation per parameter), and so are the encoders. An
instrument sees each hand in postures of its own, with 0.2 mm of noise per axis; all of it is one
job. In postures that were not measured both hands are compared with the truth in one frame: after
one rigid registration of both together, so that a torso that fits one arm alone would show. What is
stated is what the covariance of the answer says of the same. Writes ``results/whole_robot.md``.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import Final

import numpy as np
from joblib import Parallel, delayed

from suta_calib import Robot, calibrate

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results" / "whole_robot.md"
URDF: Final = ROOT / "examples" / "whole_robot" / "robot.urdf"
HANDS: Final = {"left": ("left_hand", None), "right": ("right_hand", None)}
# The simulated hands of the tests are those of the study.
sys.path.insert(0, str(ROOT))
from tests.support.torso_robot import built  # noqa: E402
from tests.support.two_armed import TipError, both_tips, tip_errors  # noqa: E402


def of_seed(seed: int) -> tuple[str, dict[str, TipError], int]:
    """Verdict, tip errors by hand, and how many unknowns were estimated."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(seed)
    robot = Robot.from_urdf(URDF, HANDS)
    truth = built(robot, rng)
    fitted, held_out = both_tips(robot, truth, 80, rng), both_tips(robot, truth, 30, rng)
    result = calibrate(robot, fitted, validation=held_out, free=["geometric", "*.offset"])
    errors = tip_errors(robot, result.solution, truth, rng)
    return result.assessment.level, errors, len(result.solution.free)


def page(found: list[tuple[str, dict[str, TipError], int]]) -> str:
    """A table: of each hand, RMS over the seeds of error, of what is stated, and of their ratio."""
    good = sum(level == "good" for level, *_ in found)
    lines = [
        "# Tip errors of both hands of one robot",
        "",
        f"`python benchmarks/whole_robot.py` writes this page: {len(found)} seeds, {found[0][2]} "
        f"unknowns, {good} verdicts",
        "*good*. Error over stated is the RMS over the seeds; it should be 1.",
        "",
        "| hand | error, mm | stated, mm | error / stated | least | most |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for hand in HANDS:
        pairs = np.array([errors[hand] for _, errors, _ in found])
        ratios = pairs[:, 0] / pairs[:, 1]
        size = 1e3 * np.sqrt(np.mean(pairs**2, axis=0))
        numbers = (*size, np.sqrt(np.mean(ratios**2)), ratios.min(), ratios.max())
        lines.append(f"| {hand} | {' | '.join(f'{number:.3f}' for number in numbers)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run every seed, write the page, print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    found = Parallel(n_jobs=options.processes)(delayed(of_seed)(k) for k in range(options.seeds))
    RESULTS.write_text(page(found), encoding="utf-8")
    print(page(found))


if __name__ == "__main__":
    main()
