"""The moving pictures of the gallery: `python docs/figures/gallery.py`, some two minutes.

Each is computed from the repository's data by the package, and written as a WebP file. What a
caption says in numbers is printed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.colors import BoundaryNorm
from PIL import Image

from suta_calib import CalibrationJob, Selection, SolverOptions, calibrate, calibrate_hand_eye
from suta_calib.analysis import TipMapOptions, tip_map_of_solution
from suta_calib.check import Checker, Follow
from suta_calib.geometry import (
    register_points,
    rotation_from_quaternion,
    rotation_from_vector,
)
from suta_calib.plotting.look import BLUE, GREY, ORANGE
from suta_calib.plotting.planar import draw_arm
from suta_calib.terms import Term
from suta_calib.units import mm

FOLDER = Path(__file__).resolve().parent / "gallery"
ROOT = FOLDER.parents[2]
# A phone shows the whole width: few words, large letters.
LOOK = {"font.size": 13, "axes.titlesize": 14, "legend.fontsize": 12}
DPI = 80
Frames = Iterator[tuple[Any, int]]


def main() -> None:
    """Draw them all."""
    FOLDER.mkdir(exist_ok=True)
    with plt.rc_context(LOOK):
        for draw in (touching, slipping, learning, misreading):
            write(draw.__name__, draw())


def write(name: str, frames: Frames) -> None:
    """One file of the frames: each a figure, and for how long it is shown, ms."""
    pictures, times = [], []
    for figure, time in frames:
        file = io.BytesIO()
        figure.savefig(file, dpi=DPI)
        plt.close(figure)
        pictures.append(Image.open(file).convert("RGB"))
        times.append(time)
    more: dict[str, Any] = {"append_images": pictures[1:], "duration": times, "loop": 0}
    path = FOLDER / f"{name}.webp"
    pictures[0].save(path, save_all=True, quality=60, method=6, **more)
    print(f"{path.name}: {len(times)} frames, {path.stat().st_size / 1024:.0f} kB")


def first(term: Term, count: int) -> Term:
    """The first rows of a term."""
    return term.over_poses(term.poses.with_samples(term.poses.samples.take(range(count))))


# How far an arm like the SUTA may be from its URDF: what is not yet measured is as unsure as that.
UNKNOWN = [
    Selection(("*.offset",), prior_rad=np.radians(0.75)),
    Selection(("joint_[2-6].z", "tip.y", "tip.z"), prior_m=2e-3),
    Selection(("joint_?.r[xy]",), prior_rad=np.radians(0.1)),
    Selection(("joint_?.[xy]",), prior_m=1.2e-3),
]
LEVELS = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0)


def touching() -> Frames:
    """The SUTA touches an artefact, then one point, and the uncertainty of its tip shrinks."""
    job = CalibrationJob.load(ROOT / "data/suta/calibration_full.yaml")
    artefact, point = job.observations
    about = TipMapOptions(
        box=np.array([[0.21, -0.32, 0.01], [0.76, 0.35, 0.45]]),
        place=np.array([0.46, 0.01, 0.04]),
        grid=31,
    )
    steps = [(n, 0) for n in (6, 9, 15, 30, 45, 90, 135, 180, 225)]
    steps += [(225, n) for n in (3, 6, 10, 20, 40, 60)]
    for touched, turned in steps:
        terms = [first(term, n) for term, n in ((artefact, touched), (point, turned)) if n]
        result = calibrate(job.arm, terms, free=UNKNOWN, options=SolverOptions(starts=1))
        tips = tip_map_of_solution(result.solution, about)
        last = terms[-1].poses.samples
        size = mm(tips.registered.rms)
        print(f"  {touched} touches of the artefact, {turned} of the point: {size:.2f} mm")
        figure, axes = plt.subplots(figsize=(7, 5.6), layout="constrained")
        side = tips.sections[0]
        shades = mpl.colormaps["Blues"].resampled(len(LEVELS) - 1)
        filled = axes.contourf(
            mm(side.u),
            mm(side.v),
            np.ma.masked_invalid(mm(side.registered)),
            LEVELS,
            cmap=shades,
            norm=BoundaryNorm(LEVELS, len(LEVELS) - 1),
            extend="both",
        )
        bar = figure.colorbar(
            filled, ax=axes, ticks=LEVELS, label="uncertainty of the tip, mm (tool upright)"
        )
        bar.ax.set_yticklabels([f"{level:g}" for level in LEVELS])
        values = result.solution.values
        seen = [term.poses.samples.q for term in terms]
        places = [mm(side.project(result.arm.forward(q)[1])) for q in seen]
        axes.plot(*places[0].T, ".", color="black", ms=4)
        if turned:
            axes.plot(*places[1].T, "o", color=ORANGE, mec="black", ms=7)
        draw_arm(axes, mm(side.project(job.arm.at(values).skeleton(last.q[-1]).points)))
        axes.set(aspect="equal", xlim=(-120, 820), ylim=(-60, 740), xlabel="mm", ylabel="mm")
        words = f"{touched} touches of the artefact" + f", {turned} of a point" * bool(turned)
        axes.set_title(f"{words}\ntool tilted up to 45°: {size:.2g} mm (RMS)", loc="left")
        yield figure, 3500 if turned == 60 else 1500 if (touched, turned) == (225, 0) else 700


SLIP = np.radians(0.2)


def slipping() -> Frames:
    """The evidence that something changed, touch by touch: a sound arm, and a zero that slipped."""
    job = CalibrationJob.load(ROOT / "data/suta/calibration_full.yaml")
    checker = Checker(job.run().solution)
    (new,) = job.validation
    samples = new.poses.samples
    slipped = samples.q.copy()
    slipped[:, job.arm.joints.index("joint_3")] += SLIP
    follows = [Follow(checker), Follow(checker)]
    both = [samples, replace(samples, q=slipped)]
    known: list[list[float]] = [[], []]
    said = words = ""
    for count in range(2, 17):
        for follow, rows, evidence in zip(follows, both, known, strict=True):
            term = new.over_poses(new.poses.with_samples(rows.take(range(count))))
            step = follow.add(term, 0 if count == 2 else count - 1)
            evidence.append(step.evidence)
        if follows[1].step.changed and not said:
            check = follows[1].check()
            said = f"{check.assessment.sentence}: {check.changed[0].amount}"
            words = said.replace(" since", "\nsince").replace(": ", ":\n")
            print(f"  after {count} touches: {said} (true: {np.degrees(SLIP):.1f}°)")
        figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
        rows = np.arange(2, count + 1)
        axes.axhline(100, color="black", lw=1, ls="--")
        axes.text(16.3, 115, "one false alarm in 100 arms", ha="right", va="bottom")
        for evidence, colour, label in (
            (known[0], BLUE, "nothing changed"),
            (known[1], ORANGE, "joint_3 reads 0.2° too much"),
        ):
            axes.plot(rows, evidence, "-o", color=colour, ms=4, label=label)
        axes.set(yscale="log", xlim=(1, 17), ylim=(0.1, 1e4), xlabel="new touches")
        axes.set_ylabel("evidence of a change")
        axes.legend(loc="upper left", frameon=False)
        if said:
            axes.text(16.3, 2, words, ha="right", va="bottom", weight="bold")
        axes.set_title("Is the calibration still right?", loc="left")
        yield figure, 4000 if count == 16 else 500


# `T_hand_eye` of data/poses, mm (its README.md).
TRUE = np.array([31.0, -62.0, 94.0])


def misreading() -> Frames:
    """A camera on a hand, pose by pose: two are wrong, and are named as soon as they come."""
    rows = np.genfromtxt(ROOT / "data/poses/hand_eye.csv", delimiter=",", names=True)
    hand, seen = (
        (
            rotation_from_quaternion(np.stack([rows[f"{k}_q{c}"] for c in "xyzw"], axis=1)),
            np.stack([rows[f"{k}_{c}"] for c in "xyz"], axis=1),
        )
        for k in "ab"
    )
    counts, ours, plain, named = [], [], [], {}
    for count in range(4, len(rows) + 1):
        some = tuple(each[:count] for each in hand), tuple(each[:count] for each in seen)
        found = calibrate_hand_eye(*some, model="AX=ZB")
        squares = calibrate_hand_eye(*some, model="AX=ZB", robust=False)
        counts.append(count)
        for errors, answer in ((ours, found), (plain, squares)):
            errors.append(float(np.linalg.norm(mm(answer.X[:3, 3]) - TRUE)))
        for row in found.outliers:
            named.setdefault(row, count)
        print(f"  {count} poses: {plain[-1]:.2f} mm, {ours[-1]:.2f} mm, named {found.outliers}")
        figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
        axes.plot(counts, plain, "-o", color=ORANGE, ms=4, label="least squares of all poses")
        axes.plot(counts, ours, "-o", color=BLUE, ms=4, label="suta-calib hand-eye")
        for row, since in named.items():
            axes.axvline(row + 1, color=GREY, lw=1, ls=":")
            axes.text(row + 1.3, 0.06, f"pose {row + 1} is wrong:\nnamed at {since}", va="bottom")
        axes.set(yscale="log", xlim=(3, 31), ylim=(0.05, 100), xlabel="poses")
        axes.set_ylabel("error of the camera's place, mm")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.legend(loc="upper right", frameon=False)
        axes.set_title("Where is the camera on the hand?", loc="left")
        yield figure, 4000 if count == len(rows) else 300


def learning() -> Frames:
    """Errors of a measured UR5 where it was not fitted, by how many poses were."""
    job = CalibrationJob.load(ROOT / "examples/ur5_laser_tracker/calibration.yaml")
    (fitted, *_), (_, held_out) = job.observations, job.validation
    q, seen = held_out.poses.samples.q, held_out.poses.samples.position
    _, position = job.arm.forward(q)
    turned, moved = register_points(position, seen)
    nominal = position @ turned.T + moved - seen
    random = np.random.default_rng(0).permutation(len(fitted.poses))
    some = np.arange(0, len(seen), 4)
    counts, sizes = [], []
    for count in (0, 5, 7, 10, 14, 20, 30, 50, 100, 200, 400, len(random)):
        error = nominal
        if count:
            rows = fitted.poses.samples.take(sorted(random[:count]))
            term = fitted.over_poses(fitted.poses.with_samples(rows))
            values = calibrate(job.arm, term).solution.values
            x, y, z, *turn = (values[f"base.{k}"] for k in ("x", "y", "z", "rx", "ry", "rz"))
            _, position = job.arm.forward(q, values)
            error = position @ rotation_from_vector(turn).T + np.array([x, y, z]) - seen
        size = mm(float(np.sqrt(np.mean(np.sum(error**2, axis=1)))))
        print(f"  {count} poses fitted: {size:.3f} mm RMS")
        counts.append(count)
        sizes.append(size)
        figure, (above, curve) = plt.subplots(1, 2, figsize=(9, 4.8), layout="constrained")
        arrows = {"angles": "xy", "scale_units": "xy", "scale": 0.01, "width": 0.006}
        colour = BLUE if count else ORANGE
        above.quiver(*seen[some, :2].T, *error[some, :2].T, color=colour, **arrows)
        above.set(aspect="equal", xlim=(-0.85, -0.1), ylim=(-0.8, 0.2))
        above.set(xlabel="x, m", ylabel="y, m", title="errors × 100, from above")
        curve.axhline(sizes[0], color=ORANGE, lw=2)
        curve.text(700, sizes[0] * 0.93, "as delivered", color=ORANGE, ha="right", va="top")
        curve.plot(counts[1:], sizes[1:], "-o", color=BLUE)
        curve.set(xscale="log", yscale="log", xlim=(4, 900), ylim=(0.08, 2))
        curve.set_yticks([0.1, 0.2, 0.5, 1, 2])
        curve.yaxis.set_minor_formatter("")
        for axis in (curve.xaxis, curve.yaxis):
            axis.set_major_formatter("{x:g}")
        curve.set(xlabel="poses that were fitted", ylabel="error, mm RMS")
        curve.set_title(f"{count} fitted: {size:.2f} mm on {len(seen)} others")
        curve.grid(color=GREY, alpha=0.3)
        yield figure, 4000 if count == len(random) else 1500 if not count else 800


if __name__ == "__main__":
    main()
