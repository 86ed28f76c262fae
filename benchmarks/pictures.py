"""X from pictures: how near the truth, how true its ±, how well left-out pictures are predicted.

    python benchmarks/pictures.py                     # simulated: docs/guides/pictures_table.md
    python benchmarks/pictures.py FOLDER …            # your own sets, on the console
    python benchmarks/pictures.py FOLDER … --table PAGE.md

A FOLDER has poses.csv (image, a_x, …), board.yaml, and corners.csv or pictures in images/. It may
have camera.yaml, and truth.json with T_hand_camera or, of a camera beside the robot,
T_base_camera; without that say --setup. Pictures are left out by five folds, of simulated sets
in the first seed alone; the peer is plain least squares of the reprojection errors, with the
camera's file held and with free intrinsics.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import NamedTuple

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import cv2
import numpy as np
from joblib import Parallel, delayed
from pose_peers import Pictures

from suta_calib import SutaCalibError
from suta_calib.arrays import BoolArray, FloatArray
from suta_calib.geometry import rms_length, vector_from_rotation
from suta_calib.measurements import (
    Board,
    Camera,
    Corners,
    HandPoses,
    corners_of,
    read_board,
    read_camera,
    read_corners,
    read_hand_poses,
)
from suta_calib.pose_calibration import (
    PictureCalibration,
    View,
    hand_eye_from_pictures,
)
from suta_calib.terms import EyeSetup
from suta_calib.units import deg, mm
from suta_calib.vision import (
    RenderOptions,
    calibrate_camera,
    detect,
    find_pictures,
    finder_of,
    rendered,
)

ROOT = Path(__file__).resolve().parents[1]
# The boards before cameras of the tests are those of the study.
sys.path.insert(0, str(ROOT / "tests" / "support"))
from lens_scenes import (  # noqa: E402
    BOARD,
    anywhere,
    boards_seen,
    camera,
    hand_of,
    poses_of,
)

TABLE = ROOT / "docs" / "guides" / "pictures_table.md"
FOLDS = 5
# Standard deviations; of 100 sets, all six numbers of X are inside in 98.
INSIDE = 3.0


# ── sets ─────────────────────────────────────────────────────────────────────────────────────
@dataclass(frozen=True, eq=False)
class PictureSet:
    """Pictures of a board with the poses of a robot.

    Attributes:
        name: of the set.
        hand: ``T_base_hand`` of every picture.
        corners: in the pictures.
        board: that they show.
        camera: as its file has it; None without one.
        setup: where the camera is.
        X: (4, 4) true pose of the camera, m; None where nobody knows it.
        lens: name of the model of the lens that took them; empty where nobody knows it.
        corner_error: RMS of the corners found in rendered pictures, px.
    """

    name: str
    hand: HandPoses
    corners: Corners
    board: Board
    camera: Camera | None
    setup: EyeSetup
    X: FloatArray | None = None
    lens: str = ""
    corner_error: float = np.nan

    @property
    def seen(self) -> Pictures:
        """For plain least squares."""
        rotation, position = self.hand.pose
        hand = np.tile(np.eye(4), (len(position), 1, 1))
        hand[:, :3, :3], hand[:, :3, 3] = rotation, position
        row = {name: k for k, name in enumerate(self.hand.image.tolist())}
        picture = np.array([row[name] for name in self.corners.image.tolist()])
        points = self.board.positions(self.corners.point)
        return Pictures(self.setup, hand, picture, points, self.corners.pixel)

    def take(self, rows: BoolArray) -> PictureSet:
        """Some pictures (n,) alone.

        A camera that was calibrated from all corners of this set stays one of these.
        """
        rotation, position = self.hand.pose
        lines = np.array(self.hand.lines)[rows]
        hand = replace(
            self.hand,
            pose=(rotation[rows], position[rows]),
            image=self.hand.image[rows],
            lines=tuple(lines.tolist()),
        )
        corners = self.corners.take(np.isin(self.corners.image, hand.image))
        own = self.camera
        if own is not None and own.corners == self.corners.digest:
            own = replace(own, corners=corners.digest)
        return replace(self, hand=hand, corners=corners, camera=own)

    def solved(self) -> PictureCalibration:
        """X and Z by ours."""
        view = View("default", self.corners, self.board, self.camera)
        return hand_eye_from_pictures(self.hand, [view], setup=self.setup, model="AX=ZB")


def read_set(folder: Path, setup: EyeSetup) -> PictureSet:
    """A set from its files; the setup is that of its truth, if it has one."""
    hand, board = read_hand_poses(folder / "poses.csv"), read_board(folder / "board.yaml")
    camera_file, truth, X = folder / "camera.yaml", folder / "truth.json", None
    own = read_camera(camera_file) if camera_file.exists() else None
    if (found := folder / "corners.csv").exists():
        corners = read_corners(found)
    else:
        detection = detect(find_pictures([folder / "images"]), board, own)
        corners, board = detection.corners, detection.board
    if truth.exists():
        known = json.loads(truth.read_text(encoding="utf-8"))
        setup = "eye-to-hand" if "T_base_camera" in known else "eye-in-hand"
        X = np.array(known["T_base_camera" if setup == "eye-to-hand" else "T_hand_camera"])
    whole = PictureSet(folder.name, hand, corners, board, own, setup, X)
    both = np.isin(hand.image, corners.images)
    corners = corners.take(np.isin(corners.image, hand.image[both]))
    return replace(whole, corners=corners).take(both)


@dataclass(frozen=True)
class Case:
    """How sets are simulated.

    Attributes:
        lens: of the tests' cameras.
        setup: where the camera is.
        width: of a picture, px; its height is three fourths.
        robot: what the robot's poses err by, m and rad.
        sigma: scatter of a projected corner, px.
        rendered: whether pictures are rendered and searched, in place of projected corners.
        spoilt: whether they are blurred, noisy, dark at the edges, and JPEG.
        filed: whether a camera file is given, calibrated from twenty other pictures.
        pictures: how many there are.
        most: sets at most, where each takes long.
    """

    lens: str
    setup: EyeSetup
    width: int = 1280
    robot: tuple[float, float] = (3e-4, 3.5e-4)
    sigma: float = 0.1
    rendered: bool = False
    spoilt: bool = False
    filed: bool = False
    pictures: int = 20
    most: int = 1000

    @property
    def name(self) -> str:
        """For a table."""
        how = "projected"
        if self.rendered:
            how = "rendered, blur, noise, JPEG, vignetting" if self.spoilt else "rendered"
        poses = "" if any(self.robot) else ", exact poses"
        camera_file = ", camera file" if self.filed else ""
        size = f"{self.width} x {self.width * 3 // 4}"
        return f"{self.lens}, {self.setup}, {size}, {how}{poses}{camera_file}"

    def made(self, seed: int) -> PictureSet:
        """The set of a seed."""
        true, random = camera(self.lens, self.width), np.random.default_rng([seed, 11])
        sigma, least = (0.0, len(BOARD.points)) if self.rendered else (self.sigma, 30)
        seen = boards_seen(true, seed, self.pictures, sigma, roll=1.2, least=least)
        on_hand = anywhere(random.uniform(-0.1, 0.1, 3), random)
        beside = anywhere([0.8, 0.3, 0.2], random)
        X, Z = (on_hand, beside) if self.setup == "eye-in-hand" else (beside, on_hand)
        hand = poses_of(hand_of(seen.poses, X, Z, self.setup, self.robot, random))
        corners, off = seen.corners.take(true.inside(seen.corners.pixel)), np.nan
        if self.rendered:
            corners, off = self._searched(true, seen.poses, random)
        own = None
        if self.filed:
            others = boards_seen(true, seed + 1000, 20, self.sigma).corners
            own = calibrate_camera(others, BOARD, true.width, true.height).camera
        whole = PictureSet(self.name, hand, corners, BOARD, own, self.setup, X, true.lens.name, off)
        return whole.take(np.isin(hand.image, corners.images))

    def _searched(
        self, true: Camera, poses: FloatArray, random: np.random.Generator
    ) -> tuple[Corners, float]:
        """Corners found in rendered pictures, and by how much they are off (RMS, px)."""
        search, images, numbers = finder_of(BOARD), list[str](), []
        pixels, off = list[FloatArray](), list[FloatArray]()
        how = RenderOptions(samples=1 if true.width > 2000 else 3)
        if self.spoilt:
            how = replace(how, blur=1.5 * true.width / 1280, noise=0.0)
        for k, pose in enumerate(poses):
            picture = rendered(BOARD, true, pose, random, how)
            try:
                found = search.find(_spoilt(picture, random) if self.spoilt else picture)
            except SutaCalibError:
                continue  # the board reaches over the edge of the picture
            there = BOARD.positions(found.point) @ pose[:3, :3].T + pose[:3, 3]
            off.append(found.pixel - true.project(there))
            images += [f"{k:02d}.png"] * len(found.point)
            numbers.append(found.point)
            pixels.append(found.pixel)
        corners = corners_of(np.array(images), np.concatenate(numbers), np.concatenate(pixels))
        return corners, rms_length(np.concatenate(off))


def _spoilt(picture: FloatArray, random: np.random.Generator) -> FloatArray:
    """Half as bright in the corners, a noise of five grey levels, and a JPEG of quality 60."""
    height, width = picture.shape
    down, right = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    dark = picture * (1.0 - 0.25 * (down**2 + right**2))
    noisy = np.clip(np.round(dark + 5.0 * random.standard_normal(dark.shape)), 0, 255)
    packed = cv2.imencode(".jpg", noisy.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 60])[1]
    return cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)


IN_HAND, TO_HAND = "eye-in-hand", "eye-to-hand"
EXACT = (0.0, 0.0)
CASES = (
    *(Case(lens, IN_HAND) for lens in ("plumb_bob", "rational_polynomial", "equidistant")),
    *(
        Case(lens, TO_HAND, filed=True)
        for lens in ("plumb_bob", "rational_polynomial", "equidistant")
    ),
    Case("fisheye of 190 deg", IN_HAND),
    Case("fisheye of 190 deg", TO_HAND, filed=True),
    Case("plumb_bob", IN_HAND, 640, EXACT),
    Case("plumb_bob", TO_HAND, 3840, (5e-4, 3.5e-4), 0.3),
    Case("plumb_bob", IN_HAND, 640, rendered=True, pictures=15),
    Case("plumb_bob", IN_HAND, 640, EXACT, rendered=True, spoilt=True, pictures=15),
    Case("rational_polynomial", TO_HAND, rendered=True, spoilt=True, pictures=15),
    Case("equidistant", TO_HAND, 640, rendered=True, spoilt=True, pictures=15),
    Case("fisheye of 190 deg", IN_HAND, rendered=True, pictures=15),
    Case("plumb_bob", TO_HAND, 3840, rendered=True, spoilt=True, pictures=12, most=1),
)


# ── answers ──────────────────────────────────────────────────────────────────────────────────
@dataclass(frozen=True)
class Outcome:
    """What became of a set.

    Attributes:
        name: of the set, or of how it was simulated.
        pictures: with a board, and used by ours.
        shift: of X from the truth, m; NaN where nobody knows it.
        turn: likewise, rad.
        ratios: (6,) errors of X over their standard deviations.
        left_out: reprojection errors of left-out pictures, px RMS: ours, plain with the camera's
            file held, plain with free intrinsics; NaN where none were left out.
        corner_error: of rendered pictures, px RMS.
        lens: that was chosen, or is in the file.
        right: whether it is that which took the pictures; None where it was not chosen.
        seconds: processor time of ours.
        level: of the verdict.
    """

    name: str
    pictures: tuple[int, int]
    shift: float
    turn: float
    ratios: FloatArray
    left_out: FloatArray
    corner_error: float
    lens: str
    right: bool | None
    seconds: float
    level: str

    @property
    def beyond(self) -> bool:
        """Whether a number of X is off by more than three standard deviations."""
        return bool(np.abs(self.ratios).max() > INSIDE)

    @property
    def sentence(self) -> str:
        """In short."""
        ours, held, free = self.left_out
        off = f"X off by {mm(self.shift):.3f} mm, {deg(self.turn):.4f}°; "
        plain = f"plain {free:.3f}" if np.isnan(held) else f"plain {held:.3f}, {free:.3f}"
        return (
            ("" if np.isnan(self.shift) else off)
            + ("" if np.isnan(ours) else f"left out {ours:.3f} px ({plain}); ")
            + f"{self.lens}; {self.level}"
            + ("; BEYOND 3 ±" if self.beyond else "")
        )


def outcome(one: PictureSet, folds: bool) -> Outcome:
    """Ours on all pictures, and, if asked, everybody by five folds."""
    began = process_time()
    answer = one.solved()
    seconds = process_time() - began
    (found,) = answer.cameras
    shift, turn, ratios = np.nan, np.nan, np.full(6, np.nan)
    if one.X is not None:
        off = found.X[:3, 3] - one.X[:3, 3]
        turned = vector_from_rotation(one.X[:3, :3].T @ found.X[:3, :3])
        shift, turn = float(np.linalg.norm(off)), float(np.linalg.norm(turned))
        ratios = np.concatenate([off, turned]) / found.std["X"]
    chosen = found.camera.lens.name
    return Outcome(
        name=one.name,
        pictures=(len(found.images), int(found.inliers.sum())),
        shift=shift,
        turn=turn,
        ratios=ratios,
        left_out=left_out(one) if folds else np.full(3, np.nan),
        corner_error=one.corner_error,
        lens=chosen,
        right=None if one.camera is not None or not one.lens else chosen == one.lens,
        seconds=seconds,
        level=answer.assessment.level,
    )


def left_out(one: PictureSet) -> FloatArray:
    """RMS reprojection errors (3,) of all pictures, each predicted without it, px.

    NaN where a fold leaves too few pictures to determine X.
    """
    count = len(one.hand.image)
    fold, seen = np.random.default_rng(0).permutation(count) % FOLDS, one.seen
    errors: tuple[list[FloatArray], ...] = ([], [], [])
    for k in range(FOLDS):
        rest, out = one.take(fold != k), seen.take(fold == k)
        try:
            (ours,) = rest.solved().cameras
        except SutaCalibError:
            return np.full(3, np.nan)
        errors[0].append(out.errors(ours.X, ours.Z, ours.camera))
        for which, start in ((1, one.camera), (2, ours.camera)):
            if start is not None:
                free = which == 2
                plain = rest.seen.least_squares(ours.X, ours.Z, start, free=free)
                errors[which].append(out.errors(*plain))
    return np.array([rms_length(np.concatenate(each)) if each else np.nan for each in errors])


# ── tables ───────────────────────────────────────────────────────────────────────────────────
HEADS = (
    "set",
    "pictures",
    "corners off, px",
    "X off, mm",
    "X off, °",
    "error / ±",
    "inside 3 ±",
    "left out, px: ours",
    "plain, camera held",
    "plain, camera free",
    "lens",
    "verdict",
    "s",
)


def row(outcomes: Sequence[Outcome]) -> list[str]:
    """Of the sets of one case: RMS over them, the median of the time."""

    def rms(values: Sequence[float] | FloatArray) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    count, first = len(outcomes), outcomes[0]
    known = not np.isnan(first.shift)
    rights = [each.right for each in outcomes if each.right is not None]
    levels = [each.level for each in outcomes]
    seen, used = np.sum([each.pictures for each in outcomes], axis=0)
    chosen = f"{sum(rights)} of {len(rights)}" if rights else "in the file"
    if not first.right and not rights and len(outcomes) == 1:
        chosen = first.lens
    folded = [each.left_out for each in outcomes if not np.isnan(each.left_out[0])]
    left = [rms([each[k] for each in folded]) if folded else np.nan for k in range(3)]
    corner_error = rms([each.corner_error for each in outcomes])
    return [
        first.name + (f" ({count})" if count > 1 else ""),
        f"{used} of {seen}",
        _number(corner_error, 3),
        _number(mm(rms([each.shift for each in outcomes])), 3),
        _number(deg(rms([each.turn for each in outcomes])), 4),
        _number(rms([each.ratios for each in outcomes]), 2),
        f"{sum(not each.beyond for each in outcomes)} of {count}" if known else "–",
        *(_number(value, 3) for value in left),
        chosen,
        ", ".join(
            f"{level} {levels.count(level)}" if count > 1 else level
            for level in dict.fromkeys(levels)
        ),
        f"{np.median([each.seconds for each in outcomes]):.1f}",
    ]


def _number(value: float, digits: int) -> str:
    return "–" if np.isnan(value) else f"{value:.{digits}f}"


def table(found: Sequence[Outcome]) -> str:
    """A row for each name; columns that say nothing of these sets are left out."""
    names = dict.fromkeys(each.name for each in found)
    rows = [row([each for each in found if each.name == name]) for name in names]
    kept = [k for k in range(len(HEADS)) if any(cells[k] != "–" for cells in rows)]
    lines = [[HEADS[k] for k in kept], ["---", *["--:"] * (len(kept) - 1)]]
    lines += [[cells[k] for k in kept] for cells in rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


class Job(NamedTuple):
    """A set that is made and measured: its name, and whether pictures are left out."""

    name: str
    make: Callable[[], PictureSet]
    folds: bool = True

    def outcome(self) -> Outcome:
        """In whatever process."""
        return outcome(self.make(), self.folds)


def run(jobs: Sequence[Job], processes: int) -> Iterator[Outcome]:
    """The outcome of every set, and a line on each as it comes."""
    work = Parallel(n_jobs=processes, return_as="generator")
    found = work(delayed(job.outcome)() for job in jobs)
    for k, (each, job) in enumerate(zip(found, jobs, strict=True), 1):
        print(f"{k} of {len(jobs)}: {job.name}: {each.sentence}", file=sys.stderr, flush=True)
        yield each


def main() -> None:
    """Measure, and write the table."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("folders", nargs="*", type=Path)
    arguments.add_argument("--setup", choices=(IN_HAND, TO_HAND), default=IN_HAND)
    arguments.add_argument("--seeds", type=int, default=2)
    arguments.add_argument("--processes", type=int, default=2)
    arguments.add_argument("--table", type=Path)
    given = arguments.parse_args()
    if given.folders:
        jobs = [
            Job(folder.name, partial(read_set, folder, given.setup)) for folder in given.folders
        ]
    else:
        jobs = [
            Job(f"{case.name}, seed {seed}", partial(case.made, seed), seed == 0)
            for case in CASES
            for seed in range(min(given.seeds, case.most))
        ]
    try:
        text = table(list(run(jobs, given.processes)))
    except SutaCalibError as problem:
        raise SystemExit(str(problem)) from None
    print(text)
    page = given.table or (None if given.folders else TABLE)
    if page is not None:
        options = " FOLDER …" if given.folders else f" --seeds {given.seeds}"
        head = f"`python benchmarks/pictures.py{options}` writes this table."
        kind = "" if given.folders else "Simulated; "
        page.write_text(f"*{kind}{head}*\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main()
