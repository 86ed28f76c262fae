"""An answer of `hand-eye`, `pivot` or `register` that was written, and new poses for it.

The poses that it was made from are read again and fitted by the kind of observation that the answer
is of: over poses that were measured, a hand-eye calibration is a `HandEye`, a pivot a `FixedPoint`
with the tip unknown, a registration a `TrackedPoint`. What a check needs follows from that: the
scatter of the poses, the covariance, and what may have changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from suta_calib.check.checking import Checker
from suta_calib.check.target_poses import corners_in, is_picture, target_poses
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError
from suta_calib.measurements import (
    Board,
    Camera,
    Samples,
    read_board,
    read_camera,
    read_corners,
)
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.measurements.pose_files import (
    PointSet,
    PosePairs,
    ToolPoses,
    read_corresponding_points,
    read_hand_poses,
    read_pose_pairs,
    read_tool_poses,
)
from suta_calib.solver.options import SolverOptions
from suta_calib.solver.problem import Problem
from suta_calib.solver.solve import solve
from suta_calib.terms import FixedPoint, HandEye, MeasuredPoses, Term, TrackedPoint
from suta_calib.terms.hand_eye_start import as_eye_in_hand, some_poses
from suta_calib.words import enumerated


@dataclass(frozen=True)
class PoseCommand:
    """A command that answers from poses alone.

    Attributes:
        name: of it.
        key: of its answer's content, that no other has.
        files: what it reads.
        term: of these files, with what the answer says of how they were read; the last argument is
            True of rows that are new.
    """

    name: str
    key: str
    files: tuple[str, ...]
    term: Callable[[Sequence[Path], Mapping[str, Any], bool], Term]


def _pairs(files: Sequence[Path], content: Mapping[str, Any], new: bool) -> Term:
    del new
    pairs = read_pose_pairs(files[0])
    if pairs.several:
        expected = (
            f"one eye and one target: of several, a job of kind {HandEye.kind} can be checked"
        )
        raise SamplesError("columns eye or target", expected, file=files[0])
    rotation, position = pairs.target
    hand = as_eye_in_hand(pairs.hand, content.get("setup", "eye-in-hand"))
    return HandEye(MeasuredPoses(*hand, _samples(pairs, position=position, rotation=rotation)))


def _pictured(
    files: Sequence[Path],
    content: Mapping[str, Any],
    new: bool,
    board: Board,
    camera: Camera,
) -> Term:
    """As `_pairs`, the target where each picture's corners have it."""
    del new
    poses, *others = files
    hand = read_hand_poses(poses)
    corners = (
        corners_in(others, board, camera) if is_picture(others[0]) else read_corners(others[0])
    )
    rows, rotation, position = target_poses(hand.image.tolist(), corners, board, camera)
    of_hand = as_eye_in_hand(some_poses(hand.pose, rows), content.get("setup", "eye-in-hand"))
    origin = [f"{poses.name}:{hand.lines[row]}" for row in rows.tolist()]
    samples = Samples.from_arrays(
        [], np.zeros((len(rows), 0)), position=position, rotation=rotation, origin=origin
    )
    return HandEye(MeasuredPoses(*of_hand, samples))


def _pivoted(files: Sequence[Path], content: Mapping[str, Any], new: bool) -> Term:
    del content
    tool = read_tool_poses(files[0])
    names = ["post"] * len(tool.lines) if tool.point is None else tool.point.tolist()
    # A post may stand anywhere the next time: under another label its place is fitted anew.
    labels = [f"{name} now" if new else name for name in names]
    samples = _samples(tool, labels={"point": labels})
    return FixedPoint(MeasuredPoses(tool.rotation, tool.position, samples))


def _registered(files: Sequence[Path], content: Mapping[str, Any], new: bool) -> Term:
    del content, new
    a, b = read_corresponding_points(*files)
    upright = np.tile(np.eye(3), (len(a.position), 1, 1))
    samples = _samples(b, position=b.position)
    return TrackedPoint(MeasuredPoses(upright, a.position, samples, exact=True))


def _samples(rows: PosePairs | ToolPoses | PointSet, **columns: Any) -> Samples:
    origin = [f"{rows.path.name}:{line}" for line in rows.lines]
    return Samples.from_arrays([], np.zeros((len(origin), 0)), origin=origin, **columns)


YAML: Final = (".yaml", ".yml")
COMMANDS: Final = (
    PoseCommand("hand-eye", "X", ("POSES.csv",), _pairs),
    PoseCommand("pivot", "tip_mm", ("POSES.csv",), _pivoted),
    PoseCommand("register", "T_b_a", ("A.csv", "B.csv"), _registered),
)


@dataclass(frozen=True, eq=False)
class PoseAnswer(Displayable):
    """A written answer from poses.

    Attributes:
        file: its ``result.json``.
        content: of that file.
        command: that wrote it.
        checker: what new poses are held against.
    """

    file: Path
    content: Mapping[str, Any]
    command: PoseCommand
    checker: Checker

    @property
    def title(self) -> str:
        """What is checked."""
        return f"{self.command.name} of {self.file.parent}"

    def terms(self, files: Sequence[str | Path]) -> list[Term]:
        """New poses, in files as the command reads them.

        Raises:
            InputError: other files than the command reads.
        """
        paths = [Path(file) for file in files]
        needed = len(self.command.files)
        if len(paths) != needed and not (len(paths) > needed and is_picture(paths[-1])):
            expected = f"{enumerated(self.command.files)}, as suta-calib {self.command.name} reads"
            raise SamplesError(
                f"{len(paths)} file{'s' * (len(paths) != 1)}", expected, file=paths[0]
            )
        return [self.command.term(paths, self.content, True)]


def command_of(content: Mapping[str, Any]) -> PoseCommand | None:
    """The command that wrote an answer from poses; None of other answers."""
    return next((c for c in COMMANDS if c.key in content and "run" in content), None)


def read_pose_answer(command: PoseCommand, content: Mapping[str, Any], file: Path) -> PoseAnswer:
    """Read an answer from poses, and the poses that it was made from.

    Raises:
        InputError: these are not there any more or were changed, or it is made from other data than
            poses and pictures.
    """
    files = _inputs(command, content, file)
    if len(files) > len(command.files):
        command, files = _with_pictures(command, files, content, file)
    term = command.term(files, content, False)
    lines = set(map(str, content.get("outlier_lines") or []))
    origin = term.poses.samples.origin
    inliers = [k for k, row in enumerate(origin) if row.rpartition(":")[2] not in lines]
    solution = solve(Problem([term.take(inliers)]), SolverOptions(starts=1))
    return PoseAnswer(file, content, command, Checker(solution))


def _with_pictures(
    command: PoseCommand, files: Sequence[Path], content: Mapping[str, Any], file: Path
) -> tuple[PoseCommand, list[Path]]:
    """The command over one camera's pictures of one board, with the camera as it was calibrated."""
    tables = [path for path in files if path.suffix.lower() not in YAML]
    corners = [path for path in tables if {"image", "u", "v"} <= {*read_csv_table(path).columns}]
    poses = [path for path in tables if path not in corners]
    lens = [p for p in (file.with_name("camera.yaml"), *files) if p.is_file() and _is_camera(p)]
    boards = [path for path in files if path not in tables and not _is_camera(path)]
    if not (len(poses) == len(corners) == len(boards) == 1 and lens and "X" in content):
        raise InputError(
            f"a result of {command.name} from {enumerated([path.name for path in files])}",
            "one of poses, or of one camera's pictures of one board",
            file=file,
            where="run.inputs",
            hint="of several cameras or of profiles, the result of a job can be checked "
            "(suta-calib init)",
        )
    term = partial(_pictured, board=read_board(boards[0]), camera=read_camera(lens[0]))
    read = (*command.files, "CORNERS.csv or pictures")
    return replace(command, files=read, term=term), [*poses, *corners]


def _is_camera(path: Path) -> bool:
    return path.suffix.lower() in YAML and "camera_matrix" in path.read_text(errors="replace")


def _inputs(command: PoseCommand, content: Mapping[str, Any], file: Path) -> list[Path]:
    """The files that an answer was made from, unchanged."""
    run = content.get("run")
    inputs = run.get("inputs") if isinstance(run, dict) else None
    if not isinstance(inputs, dict) or len(inputs) < len(command.files):
        expected = f"{enumerated(command.files)} that it was made from"
        raise InputError("no files", expected, file=file, where="run.inputs")
    unchanged = []
    for name, sha256 in inputs.items():
        places = [Path(name), *(up / Path(name).name for up in (file.parent.parent, file.parent))]
        there = [place for place in places if place.is_file()]
        same = [p for p in there if hashlib.sha256(p.read_bytes()).hexdigest() == sha256]
        if not same:
            raise InputError(
                f"{there[0]}, which was changed since" if there else f"no file {name}",
                "the unchanged poses from which the answer was made: how much they scatter says "
                "what new ones may",
                file=file,
                where="run.inputs",
                hint=f"put the file back, or run suta-calib {command.name} again",
            )
        unchanged.append(same[0])
    return unchanged
