"""A calibration that was written to files, and new rows for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from suta_calib.assessment import refuse_unusable
from suta_calib.check.checking import Checker
from suta_calib.check.pose_answers import PoseAnswer, command_of, read_pose_answer
from suta_calib.check.target_poses import corners_in, is_picture, with_target_poses
from suta_calib.display import Displayable
from suta_calib.errors import InputError, SamplesError
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.job_terms import read_term
from suta_calib.job.schema import ObservationSpec
from suta_calib.measurements import Board, Camera, read_board, read_camera, write_corners
from suta_calib.measurements.csv_table import read_csv_table
from suta_calib.solver.covariance import Spread
from suta_calib.solver.fitted import Fitted
from suta_calib.solver.identifiability import Identification
from suta_calib.solver.interface import Minimum
from suta_calib.solver.problem import Problem
from suta_calib.solver.solution import Solution
from suta_calib.solver.weights import prior_groups
from suta_calib.terms.term import Term
from suta_calib.tracking.read_back import load_job
from suta_calib.tracking.uncertainty import numbers, read_json_object
from suta_calib.words import enumerated

# Columns that only a file of corners in pictures has.
_CORNERS = {"image", "point", "u", "v"}
_READ_BACK = "read back"


@dataclass(frozen=True, eq=False)
class ReadBack(Displayable):
    """A written calibration.

    Attributes:
        file: its ``result.json``.
        content: of that file.
        job: it was made from.
        checker: what new rows are held against.
    """

    file: Path
    content: Mapping[str, Any]
    job: CalibrationJob
    checker: Checker

    @property
    def title(self) -> str:
        """What is checked."""
        return self.job.title

    def terms(
        self,
        files: Sequence[str | Path],
        like: str = "",
        board: Path | None = None,
        camera: Path | None = None,
    ) -> list[Term]:
        """New rows as terms: each file by the row of the job that it is like.

        Args:
            files: of samples; beside those of pictures, the corners in them, or the pictures (files
                or folders), in which the corners are then found.
            like: kind or label of the job's row, where several suit a file.
            board: in the pictures, where it is not that of the job.
            camera: that took them, where the job has the poses of a target in place of pictures.

        Raises:
            InputError: a file that is like no row of the job, or like several.
        """
        paths = [Path(file) for file in files]
        pictures = [path for path in paths if is_picture(path)]
        samples = [path for path in paths if path not in pictures]
        with TemporaryDirectory(prefix="suta-calib-") as place:
            folder = Path(place)
            corners = [file for file in samples if _columns(file) >= _CORNERS]
            samples = [file for file in samples if file not in corners]
            if pictures:
                seen = self._seen(like, board, camera, pictures[0])
                corners.append(folder / "corners.csv")
                write_corners(corners[-1], corners_in(pictures, *seen))
            if len(corners) > 1:
                expected = "one file of corners, for the pictures of all samples"
                raise SamplesError(f"{len(corners)} files of corners", expected, file=corners[1])
            if not samples:
                expected = "the samples too: the joints' readings at each row"
                raise SamplesError("no samples", expected, file=next(iter(corners), None))
            if corners and not self._rows_with("corners", like):
                target, lens = self._seen(like, board, camera, corners[0])
                if lens is None:
                    raise self._no_camera(corners[0])
                samples = [
                    with_target_poses(file, corners[0], target, lens, folder) for file in samples
                ]
                corners = []
            return self._terms(samples, corners, like)

    def _rows_with(self, key: str, like: str) -> list[ObservationSpec]:
        """Rows of the job that have a setting."""
        return [
            row
            for row in (*self.job.spec.observations, *self.job.spec.validation)
            if key in row.settings and (not like or like in (row.kind, row.label))
        ]

    def _seen(
        self, like: str, board: Path | None, camera: Path | None, file: Path
    ) -> tuple[Board, Camera | None]:
        """The board in new pictures, and the camera that took them: the job's, or those given."""
        rows = self._rows_with("board", like)
        if rows:
            settings = rows[0].settings
            target = settings["board"] if board is None else read_board(board)
            return target, settings.get("camera") if camera is None else read_camera(camera)
        if board is None or camera is None:
            raise self._no_camera(file)
        return read_board(board), read_camera(camera)

    def _no_camera(self, file: Path) -> SamplesError:
        return SamplesError(
            "pictures",
            "samples of a kind that the job has: it looks at no board",
            file=file,
            hint="of a job with the poses of a target, give --board BOARD.yaml and --camera "
            "CAMERA.yaml: these poses are then found in the pictures",
        )

    def _terms(self, samples: Sequence[Path], corners: Sequence[Path], like: str) -> list[Term]:
        found = dict[int, list[Path]]()
        rows = (*self.job.spec.observations, *self.job.spec.validation)
        for file in samples:
            found.setdefault(self._row_for(file, rows, like), []).append(file)
        terms = []
        for number, mine in found.items():
            row = rows[number]
            row = replace(
                row, samples=tuple(map(str, mine)), sample_files=tuple(mine), exclude=None
            )
            if "corners" in row.settings:
                if not corners:
                    expected = "the file of the corners in these pictures beside it"
                    hint = "suta-calib detect PICTURES --board BOARD.yaml --out corners.csv"
                    raise SamplesError("samples of pictures", expected, file=mine[0], hint=hint)
                row = replace(row, settings={**row.settings, "corners": corners[0]})
            terms.append(read_term(self.job.arm, row, self.job.spec.path))
        fitted = self.job.observations
        return [term.beside((*fitted, *terms)) for term in terms]

    def _row_for(self, file: Path, rows: Sequence[ObservationSpec], like: str) -> int:
        """Number of the job's row that a file is like."""
        columns, suiting = _columns(file), dict[int, int]()
        refused: InputError | None = None
        for k, row in enumerate(rows):
            if like and like not in (row.kind, row.label):
                continue
            if any(same_row(row, rows[j]) for j in suiting):
                continue
            try:
                read_term(
                    self.job.arm,
                    replace(row, sample_files=(file,), samples=(str(file),), exclude=None)
                    if "corners" not in row.settings
                    else row,
                    self.job.spec.path,
                )
            except InputError as error:
                refused = refused or error
                continue
            if "corners" in row.settings and "image" not in columns:
                continue
            suiting[k] = len(
                columns & {"placement", "landmark", "point", "x", "qx", "image", "plane"}
            )
        if not suiting:
            if refused is not None:
                raise refused
            expected = f"a kind or label of {self.job.spec.path.name}"
            raise SamplesError(f"no row {like}", expected, where="--like")
        if len(suiting) > 1:
            names = [f"{rows[k].kind} {rows[k].label}".removesuffix(" default") for k in suiting]
            raise SamplesError(
                f"rows that may be {enumerated(names, 'or')}",
                "rows of one of them",
                file=file,
                hint="name its kind or label with --like",
            )
        return next(iter(suiting))


def same_row(row: ObservationSpec, other: ObservationSpec) -> bool:
    """Whether samples of one are read as those of the other."""
    return (row.kind, row.label, row.chain, row.base_chain, row.link, row.artefact) == (
        *(other.kind, other.label, other.chain, other.base_chain, other.link, other.artefact),
    )


def _columns(file: Path) -> set[str]:
    return set(read_csv_table(file).columns)


def read_answer(path: str | Path, *, anyway: bool = False) -> ReadBack | PoseAnswer:
    """Read a result of a job, or one of poses alone: `read_back`, or `read_pose_answer`.

    Args:
        path: ``result.json``, or its folder.
        anyway: take one that says of itself that it must not be used.

    Raises:
        InputError: as these.
    """
    path = Path(path)
    file = path / "result.json" if path.is_dir() else path
    content = read_json_object(file)
    if "parameters" in content or (command := command_of(content)) is None:
        return read_back(path, anyway=anyway)
    refuse_unusable(content, file, anyway=anyway)
    return read_pose_answer(command, content, file)


def read_back(path: str | Path, *, anyway: bool = False) -> ReadBack:
    """Read a result, and the job that it was made from.

    Args:
        path: ``result.json``, or its folder.
        anyway: take one that says of itself that it must not be used.

    Raises:
        InputError: no such result; not converged, or not to be used; or its job is not found, or
            has changed since.
    """
    path = Path(path)
    file = path / "result.json" if path.is_dir() else path
    content = read_json_object(file)
    parameters = content.get("parameters")
    if not isinstance(parameters, dict) or not isinstance(content.get("noise"), list):
        expected = "the result of suta-calib calibrate"
        if command_of(content) is None:
            expected += ", or of hand-eye, pivot or register from poses"
        raise InputError("a result that is not a calibration of an arm", expected, file=file)
    if content.get("status") != "converged":
        expected = "'converged': there is no calibration to check"
        raise InputError(repr(content.get("status")), expected, file=file, where="status")
    refuse_unusable(content, file, anyway=anyway)
    job = load_job(content, file)
    return ReadBack(file, content, job, _checker(job, content, file))


def _checker(job: CalibrationJob, content: Mapping[str, Any], file: Path) -> Checker:
    """The calibration; where it was repaired, with what is known since then."""
    solution = _solution(job, content, file)
    repair = content.get("repaired")
    if not isinstance(repair, dict):
        return Checker(solution)
    table = repair.get("covariance")
    names = tuple(map(str, table.get("parameters", ()))) if isinstance(table, dict) else ()
    matrix = numbers(dict(table or {}).get("matrix"), (len(names),) * 2, file, "repaired")
    values = {
        name: float(numbers(record.get("value"), (), file, name))
        for name, record in content["parameters"].items()
    }
    return Checker(solution, values, (names, np.asarray(matrix)))


def _solution(job: CalibrationJob, content: Mapping[str, Any], file: Path) -> Solution:
    """The solution as it was, without solving."""
    problem, records = job.problem(), content["parameters"]
    if lacking := next((name for name in problem.names if name not in records), None):
        expected = f"a value of every unknown of {job.spec.path}"
        hint = "calibrate again"
        raise InputError(
            f"no value of {lacking}", expected, file=file, where="parameters", hint=hint
        )
    # What was repaired holds for later rows: those of the job had other values.
    old = dict(content.get("repaired") or {}).get("before") or {}
    values = {name: old.get(name, records[name].get("value")) for name in problem.names}
    x = np.array([float(numbers(value, (), file, name)) for name, value in values.items()])
    free = np.array(
        [k for k, name in enumerate(problem.names) if records[name].get("std") is not None],
        dtype=np.intp,
    )
    factors = {
        str(entry.get("group")): float(numbers(entry.get("factor"), (), file, "priors"))
        for entry in content.get("priors") or []
    }
    groups = prior_groups(problem)
    problem = problem.with_priors_scaled(np.array([factors.get(str(g), 1.0) for g in groups]))
    sigmas = _sigmas(problem, content, file)
    fitted = Fitted(problem, x, sigmas, free)
    nothing = np.zeros((len(x), len(x)))
    nowhere = Identification(np.setdiff1d(np.arange(len(x)), free), (), np.zeros((0, 0)))
    end = Minimum(x, 0.0, _READ_BACK, 0, True, _READ_BACK)
    return Solution(
        *(problem, end, (end,), nowhere, nowhere, free, Spread(fitted, nothing)),
        *(sigmas, sigmas, {}),
        widening=float(numbers(content.get("widening", 1.0), (), file, "widening")),
    )


def _sigmas(problem: Problem, content: Mapping[str, Any], file: Path) -> tuple[float, ...]:
    """Noise that was found of every block."""
    entries = content["noise"]
    assumed = problem.assumed_sigmas()
    if len(entries) != len(assumed):
        expected = f"that of {len(assumed)} blocks of rows, as the job has them"
        raise InputError(f"the noise of {len(entries)}", expected, file=file, where="noise")
    return tuple(float(numbers(entry.get("found"), (), file, "noise")) for entry in entries)
