"""Every pair of tips of robots with two arms, in one job, from the simulated rows to the noise.

``python benchmarks/pairs_of_tips.py [--robot NAME]``

The robots are those of example-robot-data. Of each pair both chains are off by 1 mm and 8 mrad
(standard deviation per parameter), an instrument sees both tips with 0.2 mm of noise per axis, and
rows that were not fitted are predicted. Error over predicted is the robust ratio of these: 1 where
the answer is right to the noise and to what it states. Writes ``results/pairs_of_tips.md``.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from time import process_time
from typing import Final, NamedTuple

import numpy as np

from suta_calib import Robot, calibrate, robots
from suta_calib.geometry import rms_length
from suta_calib.units import mm

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = ROOT / "benchmarks" / "results" / "pairs_of_tips.md"
# The simulated tips of the tests are those of the study.
sys.path.insert(0, str(ROOT))
from tests.support.torso_robot import built  # noqa: E402
from tests.support.two_armed import both_tips  # noqa: E402

# What ends somewhere that an instrument can see: hands, cameras, soles.
TIPS: Final = {
    "talos_full_v2": (
        "wrist_left_ft_tool_link",
        "wrist_right_ft_tool_link",
        "rgbd_rgb_optical_frame",
        "left_sole_link",
        "right_sole_link",
    ),
    "talos_reduced": ("wrist_left_ft_tool_link", "wrist_right_ft_tool_link"),
    "tiago_dual": ("hand_left_tool_link", "hand_right_tool_link", "xtion_rgb_optical_frame"),
    "tiago_pro": ("arm_left_tool_link", "arm_right_tool_link", "head_front_camera_link"),
    "baxter": ("left_gripper", "right_gripper", "head_camera_link"),
    "pr2": ("l_gripper_tool_frame", "r_gripper_tool_frame", "wide_stereo_optical_frame"),
    "romeo": ("l_gripper", "r_gripper", "l_sole"),
    "icub": ("l_hand", "r_hand", "l_sole"),
    "simple_humanoid": ("l_wrist", "r_wrist", "l_ankle"),
    "human": ("left_hand", "right_hand", "middle_head"),
    "alex_nub_hands": ("leftNub", "rightNub", "Head"),
    "g1_29dof_rev_1_0": ("left_rubber_hand", "right_rubber_hand", "left_ankle_roll_link"),
    "centauro": ("ball1_tip", "ball2_tip"),
}


class Pair(NamedTuple):
    """What became of one job.

    Attributes:
        robot, tips: which.
        shared, joints: joints that both chains have, and all.
        unknowns: that were estimated.
        level: the verdict.
        fitted, held_out: RMS of a component of the residuals and of the held-out errors, m.
        ratio: held-out errors over what is predicted.
        seconds: of processor time.
    """

    robot: str
    tips: tuple[str, str]
    shared: int
    joints: int
    unknowns: int
    level: str
    fitted: float
    held_out: float
    ratio: float
    seconds: float

    @property
    def to_the_noise(self) -> bool:
        """Whether held-out errors are what noise and covariance make of them."""
        return self.level != "bad" and 0.75 < self.ratio < 1.33


def pair(name: str, tips: tuple[str, str], poses: int = 80) -> Pair:
    """Simulate and calibrate one."""
    warnings.simplefilter("ignore")
    began, rng = process_time(), np.random.default_rng(0)
    robot = Robot.from_urdf(robots.path(name), {tip: (tip, None) for tip in tips})
    truth = built(robot, rng)
    fitted, held_out = both_tips(robot, truth, poses, rng), both_tips(robot, truth, 40, rng)
    result = calibrate(robot, fitted, validation=held_out, free=["geometric", "*.offset"])
    ratios = [errors.ratio for errors in result.examined.held_out]
    rms = [
        rms_length(np.vstack([b.residual_after for t in terms for b in t.blocks])) / np.sqrt(3.0)
        for terms in (result.examined.accuracy.calibration, result.examined.accuracy.validation)
    ]
    one, other = (set(arm.joints) for arm in robot.chains.values())
    return Pair(
        *(name, tips, len(one & other), len(robot.joints), len(result.solution.free)),
        *(result.assessment.level, *rms, max(ratios, key=lambda r: abs(np.log(r)))),
        process_time() - began,
    )


def pairs(chosen: str = "") -> Iterator[Pair]:
    """All of them, or those of one robot."""
    for name, tips in TIPS.items():
        if chosen in ("", name):
            for two in combinations(tips, 2):
                yield pair(name, two)


def page(found: list[Pair]) -> str:
    """A table, a row for each pair."""
    right = sum(one.to_the_noise for one in found)
    lines = [
        "# Pairs of tips in one job",
        "",
        f"`python benchmarks/pairs_of_tips.py` writes this page: {right} of {len(found)} pairs are "
        "right to the noise (0.2 mm).",
        "",
        "| robot | tips | joints (shared) | unknowns | verdict | fitted, mm | held out, mm | "
        "error / predicted | s |",
        "|---|---|--:|--:|---|--:|--:|--:|--:|",
    ]
    lines += [
        f"| {one.robot} | {', '.join(one.tips)} | {one.joints} ({one.shared}) | {one.unknowns} | "
        f"{one.level} | {mm(one.fitted):.3f} | {mm(one.held_out):.3f} | {one.ratio:.2f} | "
        f"{one.seconds:.1f} |"
        for one in found
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run every pair, write the page, print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", choices=TIPS, default="")
    options = parser.parse_args()
    found = list(pairs(options.robot))
    if not options.robot:
        RESULTS.write_text(page(found), encoding="utf-8")
    print(page(found))
    sys.exit(not all(one.to_the_noise for one in found))


if __name__ == "__main__":
    main()
