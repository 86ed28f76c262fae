"""What one minute of sweeping tells beside fifteen touches. Simulated.

``python benchmarks/sweep_against_touches.py [--seeds N] [--processes N]``

The SUTA of ``urdf/suta.urdf``, whose encoders and tip are off, with its tip in one socket or on one
plate. Where the tip sits scatters by 0.1 mm per axis: anew in every touch, and in a sweep after
every reversal of the hand. Sweeps are streams of 768 readings a second, thinned and tested for
lift-off as ``measure --continuous`` does. In postures that were not measured the tip is compared
with the truth, and with what the covariance of the answer says. Writes
``docs/guides/sweeping_table.md``.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from joblib import Parallel, delayed

from suta_calib import Problem, solve
from suta_calib.arrays import FloatArray
from suta_calib.emulation import HandSweep, swept_by_hand
from suta_calib.errors import JobError
from suta_calib.measurements import Samples
from suta_calib.simulation import InverseKinematics, Targets
from suta_calib.terms import KINDS, ArmPoses, Term

ROOT: Final = Path(__file__).parents[1]
TABLE: Final = ROOT / "docs" / "guides" / "sweeping_table.md"
sys.path[:0] = [str(ROOT / "tests" / "support")]
from hand_sweeps import SEAT, contact_of, hand_readings, moments_of, postures_of, suta  # noqa: E402

POSTURE: Final = np.radians([15, 175, 160, 110, -90, -125])
UNKNOWNS: Final = ("joint_[2-5].offset", "tip.x", "tip.y", "tip.z")
TOUCHES: Final = 15
PLACES: Final = {"fixed_point": ("socket", 0.0), "plane": ("plate", 0.12)}


class Outcome(NamedTuple):
    """Of one calibration: samples, clusters, ± of offsets (deg) and of the tip's place (mm)."""

    rows: int
    clusters: int
    offset: float
    place: float
    stated: float
    error: float


def outcome(term: Term, truth: dict[str, float], near: FloatArray) -> Outcome:
    """Calibrate, and compare the tip with the truth near these postures."""
    arm = suta()
    unknowns = arm.select(*UNKNOWNS)
    fit = solve(Problem([term], unknowns))
    names = list(unknowns.names)
    at = [fit.problem.names.index(name) for name in names]
    covariance = fit.covariance[np.ix_(at, at)]
    held = {fit.problem.names[k] for k in fit.identification.fixed}
    std = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    tip, step = arm.forward(near, truth)[1], 1e-6
    shifted = [arm.forward(near, truth | {name: truth[name] + step})[1] - tip for name in names]
    by = np.stack(shifted, axis=-1) / step
    off = arm.forward(near, truth | fit.problem.values(fit.x))[1] - tip
    stated = np.einsum("nij,jk,nik->n", by, covariance, by)
    of_offsets = [std[n] for n in names if n.endswith("offset") and n not in held]
    of_place = [std[n] for n in names if not n.endswith("offset") and n not in held]
    return Outcome(
        len(term.poses),
        len(np.unique(term.clusters)),
        float(np.degrees(np.sqrt(np.mean(np.square(of_offsets))))),
        1e3 * float(np.sqrt(np.mean(np.square(of_place)))) if of_place else float("nan"),
        1e3 * float(np.sqrt(np.mean(stated))),
        1e3 * float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
    )


def of_seed(seed: int, kind: str) -> dict[str, Outcome] | None:
    """Fifteen touches, and one minute, of one arm; None if the sweep meets a singular posture."""
    arm, rng = suta(), np.random.default_rng(seed)
    truth = {name: parameter.nominal for name, parameter in arm.parameters.items()}
    for parameter in arm.select(*UNKNOWNS).values():
        truth[parameter.name] += rng.normal() * (0.01 if parameter.unit == "rad" else 1e-3)
    size = PLACES[kind][1]
    how = HandSweep(0.5, size, 60.0, seating=SEAT)
    try:
        motion = swept_by_hand(arm, truth, how, posture=POSTURE, seed=seed)
    except JobError:
        return None
    moments = moments_of(hand_readings(motion))
    rows, strokes = postures_of(moments)
    touching = contact_of(moments, kind).touching[rows]
    q = np.array([moment.angles for moment in moments])
    place = KINDS[kind].place

    def term(readings: FloatArray, **labels: list[str]) -> Term:
        labels = {place: ["A"] * len(readings)} | labels
        return KINDS[kind](ArmPoses(arm, Samples.from_arrays(arm.joints, readings, labels=labels)))

    # The same hand, but it stops: the tip sits anew each time.
    still = swept_by_hand(arm, truth, HandSweep(0.5, size, 60.0), posture=POSTURE, seed=seed)
    stops = still.readings(np.linspace(2.0, 58.0, TOUCHES))
    rotation, position = arm.forward(stops, truth)
    seats = position + SEAT * rng.standard_normal(position.shape)
    found = InverseKinematics(arm, truth).solve(Targets(seats, rotation), stops, rng, 1)
    near = q[rng.integers(0, len(q), 100)] + 0.3 * rng.standard_normal((100, 6))
    swept = q[rows[touching]]
    return {
        "15 touches": outcome(term(found.q), truth, near),
        "one minute": outcome(term(swept, stroke=list(map(str, strokes[touching]))), truth, near),
        "one minute, each row by itself": outcome(term(swept), truth, near),
    }


def page(found: dict[str, list[dict[str, Outcome]]]) -> str:
    """A table: median of samples, RMS over the seeds of all else."""
    count = sum(map(len, found.values()))
    lines = [
        "*Simulated; `python benchmarks/sweep_against_touches.py` writes this table: RMS over",
        f"{count} sweeps. Where the tip sits scatters by 0.1 mm per axis.*",
        "",
        "| tip | measured | rows | count as | ± of offsets, deg | ± of tip in tool, mm | "
        "tip ± stated, mm | tip error, mm | error / stated |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for kind, outcomes in found.items():
        for name in outcomes[0]:
            each = np.array([outcome[name] for outcome in outcomes])
            rows, clusters = np.median(each[:, :2], axis=0)
            offset, place, stated, error = np.sqrt(np.nanmean(each[:, 2:] ** 2, axis=0))
            lines.append(
                f"| {PLACES[kind][0]} | {name} | {rows:.0f} | {clusters:.0f} | {offset:.3f} | "
                f"{place:.3f} | {stated:.2f} | {error:.2f} | {error / stated:.2f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the study, and write its table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeds", type=int, default=20)
    arguments.add_argument("--processes", type=int, default=2)
    given = arguments.parse_args()
    found = dict[str, list[dict[str, Outcome]]]()
    for kind in PLACES:
        run = Parallel(n_jobs=given.processes)
        each = run(delayed(of_seed)(seed, kind) for seed in range(given.seeds))
        found[kind] = [outcome for outcome in each if outcome is not None]
    text = page(found)
    TABLE.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
