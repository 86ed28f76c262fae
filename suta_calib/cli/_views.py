"""Which camera saw which board in which pictures, as options of a command say it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import click

from suta_calib.cli._options import NamedFile
from suta_calib.errors import did_you_mean
from suta_calib.geometry.lens import Lens
from suta_calib.measurements import (
    Board,
    Camera,
    Corners,
    read_board,
    read_camera,
    read_corners,
    read_corners_by_sight,
)
from suta_calib.pose_calibration.pictures import View
from suta_calib.pose_calibration.sight import ONLY


def views_of(
    corners: Sequence[NamedFile],
    board: Sequence[NamedFile],
    camera: Sequence[NamedFile],
    lens: Lens | None,
) -> tuple[list[View], bool]:
    """What every camera saw of every board, and whether names tell them apart.

    Raises:
        UsageError: names, or numbers of files, that do not fit one another.
    """
    sights = {file: read_corners_by_sight(file.path) for file in corners}
    named = any(file.name for file in (*corners, *board, *camera)) or any(
        key != ("", "") for parts in sights.values() for key in parts
    )
    if not named:
        return _in_order(corners, board, camera, lens), False
    by_view: dict[tuple[str, str], Corners] = {}
    for file, parts in sights.items():
        for (eye, target), part in parts.items():
            key = (eye or file.name or (ONLY if len(corners) == 1 else file.path.stem), target)
            if key in by_view:
                raise click.UsageError(
                    f"two --corners of camera {key[0]}: name them EYE=FILE, or give one file with "
                    "a column eye"
                )
            by_view[key] = part
    eyes = dict.fromkeys(eye for eye, _ in by_view)
    boards = {file.name: read_board(file.path) for file in board}
    cameras = _of_eyes([*eyes], camera)
    views = []
    for (eye, target), part in by_view.items():
        label, its_board = _board_of(target, boards)
        views.append(View(eye, part, its_board, cameras.get(eye), label, lens))
    return views, True


def _board_of(target: str, boards: Mapping[str, Board]) -> tuple[str, Board]:
    """Label and board of what corners call a target; empty where they do not."""
    if target in boards:
        return target or ONLY, boards[target]
    if len(boards) == 1:
        ((name, board),) = boards.items()
        if not name or not target:
            return target or name, board
    called = f"target {target}" if target else "corners without a column target"
    raise click.UsageError(
        f"{called}, and --board of {', '.join(name or 'no name' for name in boards)}: give each "
        f"target of the corners its --board TARGET=FILE{_meant(target, [*boards])}"
    )


def _of_eyes(eyes: Sequence[str], camera: Sequence[NamedFile]) -> dict[str, Camera]:
    """The camera of each eye, by name, or one without a name for the only eye."""
    if camera and not any(file.name for file in camera) and len(camera) == len(eyes) == 1:
        return {eyes[0]: read_camera(camera[0].path)}
    for file in camera:
        if file.name not in eyes:
            raise click.UsageError(
                f"--camera {file.name or file.path}; expected EYE=FILE of one of "
                f"{', '.join(eyes)}{_meant(file.name, eyes)}"
            )
    cameras = {file.name: read_camera(file.path) for file in camera}
    if cameras and len(cameras) < len(eyes):
        missing = ", ".join(eye for eye in eyes if eye not in cameras)
        raise click.UsageError(f"no --camera of {missing}: give one for each, or none")
    return cameras


def _meant(name: str, names: Sequence[str]) -> str:
    hint = did_you_mean(name, names) if name else ""
    return f" ({hint})" if hint else ""


def check_counts(
    corners: Sequence[NamedFile], board: Sequence[NamedFile], camera: Sequence[NamedFile]
) -> None:
    """Refuse numbers of files without names that do not go together."""
    if any(file.name for file in (*corners, *board, *camera)):
        return
    if len(board) not in (1, len(corners)):
        raise click.UsageError(
            f"{len(board)} --board for {len(corners)} --corners: give one for all, or one for each"
        )
    if len(camera) not in (0, len(corners)):
        raise click.UsageError(
            f"{len(camera)} --camera for {len(corners)} --corners: give none, or one for each"
        )


def _in_order(
    corners: Sequence[NamedFile],
    board: Sequence[NamedFile],
    camera: Sequence[NamedFile],
    lens: Lens | None,
) -> list[View]:
    """By the order of the options; cameras and boards are called as their files, or numbered."""
    times = len(corners) if len(board) == 1 else 1
    boards = [read_board(file.path) for file in board] * times
    of_board = [str(file.path.resolve()) for file in board] * times
    targets = {name: str(k + 1) for k, name in enumerate(dict.fromkeys(of_board))}
    cameras: list[Camera | None] = [read_camera(file.path) for file in camera]
    cameras = cameras or [None] * len(corners)
    stems = [file.path.stem for file in corners]
    unique = len(set(stems)) == len(stems)
    return [
        View(
            ONLY if len(corners) == 1 else stem if unique else str(k + 1),
            read_corners(file.path),
            boards[k],
            cameras[k],
            ONLY if len(targets) == 1 else targets[of_board[k]],
            lens,
        )
        for k, (file, stem) in enumerate(zip(corners, stems, strict=True))
    ]
