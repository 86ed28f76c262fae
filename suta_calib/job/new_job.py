"""The files a new job starts from: commented, with the arm's own joint names."""

from __future__ import annotations

import csv
import io
import os
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from suta_calib.errors import JobError, OutputError
from suta_calib.inputs import UrdfFile, XacroFile
from suta_calib.job.arm_grade import ArmGrade, arm_grade, finds_places, guessed_grade
from suta_calib.job.printed_sheets import chessboard_svg, crosses_svg
from suta_calib.measurements import Chessboard, write_text
from suta_calib.measurements.csv_table import rotation_columns
from suta_calib.measurements.sample_files import check_joint_names
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import POSITION, ROTATION
from suta_calib.model.robot import AnyArm, Robot
from suta_calib.model.urdf_tree import read_tree
from suta_calib.simulation.schema import PORTABLE_NAME
from suta_calib.terms import KINDS
from suta_calib.terms.camera_row import CAMERA_FILES
from suta_calib.terms.hand_eye_start import EYE_IN_HAND, EYE_TO_HAND, EyeSetup
from suta_calib.units import from_mm, mm

_LANDMARKS: Final = """\
# position_mm: place of the seated tip's origin, in the artefact's frame.
# Optional: rotation_rpy_deg (the tip frame's orientation in the artefact when seated, roll pitch
# yaw as in URDF) and sigma_mm (standard deviation of each coordinate).
# grade: certified (by a laboratory), machined or printed. It says how far all lengths may be wrong
# by one common factor. No residual shows this factor; every ± includes it.
"""
_ARTEFACT: Final = f"""\
# The artefact's landmarks as certified; the numbers below are an example: write yours.
{_LANDMARKS}name: my artefact
grade: certified
landmarks:
  A: {{position_mm: [0, 0, 40], sigma_mm: 0.01}}
  B: {{position_mm: [100, 0, 40], sigma_mm: 0.01}}
  C: {{position_mm: [0, 120, 60], sigma_mm: 0.01}}
  D: {{position_mm: [90, 110, 20], sigma_mm: 0.01}}
"""
# Pictures of a board.
_PICTURES: Final = next(kind for kind in KINDS.values() if kind.columns.pixels)
# Of the sheet, m; a board that a hobby arm can hold.
_CROSSES: Final = {
    f"{row}{k}": from_mm(np.array([80.0 * n, 50.0 * (k - 3), 0.0]))
    for n, row in enumerate("ABC")
    for k in range(1, 6)
}
_BOARD: Final = """\
# Inner corners: columns, rows. Other types: charuco, markers. board.svg is this board, to print:
# measure it over nine squares, correct square_mm, and uncomment scale_ppm (0.2 mm over 135 mm).
type: chessboard
corners: [8, 5]
square_mm: 15
grade: printed
# scale_ppm: 1500
"""
_SHEET: Final = f"""\
# The crosses of a printed sheet; the numbers below are an example: write yours.
{_LANDMARKS}name: my sheet
grade: printed
# A printer makes a sheet up to 1 % too long or too short, along x and along y by different factors:
# both are estimated. But the data cannot separate their mean from the lengths of the arm: unless
# the sheet is measured, the arm stays up to 1 % too long or too short, and the verdict says so.
# So measure the sheet with a steel ruler: from A3 to C3, and from A1 to A5. Uncomment the next line
# with what it says; all positions follow. (If the ruler is not good to 0.2 mm, add scale_ppm.)
# measured_mm: [160.0, 200.0]
stretch: free
landmarks:
""" + "".join(
    f"  {name}: {{position_mm: [{mm(at[0]):g}, {mm(at[1]):g}, 0], sigma_mm: 0.1}}\n"
    for name, at in _CROSSES.items()
)


class Template(NamedTuple):
    """One file of a new job: where it goes, and its whole content."""

    path: Path
    text: str


def new_job(
    arm: AnyArm,
    folder: Path,
    *,
    kinds: Sequence[str] = (),
    grade: str | None = None,
    urdf: UrdfFile | None = None,
    cameras: Mapping[str, EyeSetup] = MappingProxyType({}),
    pen: bool = False,
) -> tuple[Template, ...]:
    """Files of a job for an arm, of kinds of observation, each once; nothing is written yet.

    Args:
        arm: at nominal; of a robot, every chain has samples of each kind.
        folder: where the job will be.
        kinds: of observation, each once; those that suit the grade by default.
        grade: how the arm was made, of `ARM_GRADES`; guessed by default.
        urdf: the file that the job names; the one that the arm was read from by default.
        cameras: by name, whether each is on the hand or beside the arm. Each has a folder for its
            samples and corners, and all see a board from one file.
        pen: whether the tip is the point of a pen whose place in the hand nobody measured.

    Returns:
        ``calibration.yaml``, ``artefact.yaml`` and what else a kind needs, and empty samples files.

    Raises:
        JobError: a kind or a grade is not known, a kind is given twice, or the name of a chain
            cannot be that of a folder.
        SamplesError: a joint is called as a column of one of the kinds.
    """
    chains = dict(arm.chains) if isinstance(arm, Robot) else {"": arm}
    for what, named, where in (("chain", chains, "--tip"), ("camera", cameras, "--camera")):
        for name in filter(None, named):
            if not PORTABLE_NAME.fullmatch(name):
                expected = "letters, digits, '_', '-' and '.', because it names a folder of samples"
                raise JobError(f"the {what} '{name}'", expected, where=where)
    if cameras and isinstance(arm, Robot):
        raise JobError("cameras of several chains", "one chain with --camera", where="--camera")
    made, reason = guessed_grade(arm) if grade is None else (arm_grade(grade), "")
    kinds = kinds or made.kinds
    for kind in kinds:
        if kind not in KINDS:
            raise JobError(f"kind '{kind}'", f"one of {', '.join(KINDS)}", where="--kind")
        if kinds.count(kind) > 1:
            raise JobError(f"kind '{kind}' twice", "each kind once", where="--kind")
    # Of the samples to fit and of those held out: only the first kind is validated.
    first, *further = kinds
    folders = {(first, name): ("calibration", "validation") for name in chains}
    folders |= {(kind, name): (kind, "") for kind in further for name in chains}
    folders = {
        of: (str(PurePosixPath(fitted, of[1])), held_out and str(PurePosixPath(held_out, of[1])))
        for of, (fitted, held_out) in folders.items()
    }
    files = [
        Template(
            folder / "calibration.yaml",
            _job(arm, made, reason, _named(urdf or arm.urdf[0], folder), folders, cameras, pen=pen),
        )
    ]
    if any(KINDS[kind].needs_artefact for kind in kinds):
        files.append(Template(folder / "artefact.yaml", _SHEET if made.sheet else _ARTEFACT))
        if made.sheet:
            files.append(Template(folder / "sheet.svg", crosses_svg(_CROSSES)))
    if cameras:
        files += [
            Template(folder / "board.yaml", _BOARD),
            Template(folder / "board.svg", chessboard_svg(Chessboard(8, 5, from_mm(15.0)))),
        ]
    for name in cameras:
        files += _of_camera(folder, name, arm)
    begun = {name: text for kind in kinds for name, text in KINDS[kind].files.items()}
    files += [Template(folder / name, text) for name, text in begun.items()]
    for (kind, name), ends in folders.items():
        columns, header, joints = KINDS[kind].columns, io.StringIO(), chains[name].joints
        check_joint_names(joints, columns)
        oriented = rotation_columns() if columns.orientation == "required" else ()
        measured = (*"xyz", *oriented) if columns.position else ()
        names = (
            *columns.labels,
            *measured,
            *(number.name for number in columns.numbers if number.offered),
            *joints,
        )
        csv.writer(header, lineterminator="\n").writerow(names)
        files += [Template(folder / e / "samples.csv", header.getvalue()) for e in ends if e]
    return tuple(files)


def write_job(files: Sequence[Template]) -> None:
    """Write a new job, all of it or nothing.

    Raises:
        OutputError: one of the files exists already (all that do are named), or cannot be
            written.
    """
    taken = [str(f.path) for f in files if os.path.lexists(f.path)]
    if taken:
        raise OutputError(
            f"found {', '.join(taken)}; expected no such file: nothing is overwritten; "
            "choose another folder with --out, or move it away"
        )
    written = list[Path]()
    try:
        for file in files:
            file.path.parent.mkdir(parents=True, exist_ok=True)
            write_text(file.path, file.text)
            written.append(file.path)
    except (OSError, OutputError) as error:
        for path in written:
            path.unlink(missing_ok=True)
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"{file.path}: not written: {reason}") from error


def _job(
    arm: AnyArm,
    grade: ArmGrade,
    reason: str,
    urdf: str,
    folders: Mapping[tuple[str, str], tuple[str, str]],
    cameras: Mapping[str, EyeSetup],
    *,
    pen: bool,
) -> str:
    guessed = f", as guessed: {reason}" if reason else ""
    if isinstance(arm, Robot):
        chains = (f"{name}: {{{_ends(chain)}}}" for name, chain in arm.chains.items())
        ends = f"grade: {grade.made}, chains: {{{', '.join(chains)}}}"
        about = _CHAINS
        joints = [f"{name}: {', '.join(chain.joints)}" for name, chain in arm.chains.items()]
    else:
        ends, about, joints = f"{_ends(arm)}, grade: {grade.made}", _CHAIN, [", ".join(arm.joints)]
    return _JOB.format(
        urdf=urdf,
        ends=ends,
        arm=about,
        joints="\n".join(_wrapped(line, "#   ") for line in joints),
        grade=_wrapped(f"Its grade is {grade.name} ({grade.about}){guessed}.", "# "),
        parameters="\n".join(_parameters(arm, grade, pen=pen)),
        rows="\n".join([*_explained(folders), *_camera_rows(cameras, grade)]),
        held_out="\n".join(
            _row(*of, held_out) for of, (_, held_out) in folders.items() if held_out
        ),
    )


def _ends(arm: ArmModel) -> str:
    """Tip of a chain, and its base where that is not the root."""
    root = read_tree(*arm.urdf).root
    start = "" if arm.chain.base == root else f", base: {_quoted(arm.chain.base)}"
    return f"tip: {_quoted(arm.tip)}{start}"


def _named(urdf: UrdfFile, folder: Path) -> str:
    """What the job says of a URDF: its path from the job's folder, and the arguments of xacro."""
    file = _quoted(Path(os.path.relpath(urdf, folder)).as_posix())
    if not isinstance(urdf, XacroFile):
        return file
    given = (f"{_quoted(name)}: {_quoted(value)}" for name, value in urdf.arguments.items())
    return f"{{file: {file}, args: {{{', '.join(given)}}}}}"


def _of_camera(folder: Path, name: str, arm: AnyArm) -> Iterator[Template]:
    """Begun files of a camera: what its pictures show, and where the arm was."""
    yield Template(folder / name / "corners.csv", CAMERA_FILES["corners.csv"])
    header = ",".join(("image", *arm.joints))
    yield Template(folder / name / "samples.csv", f"{header}\n")


def _camera_rows(cameras: Mapping[str, EyeSetup], grade: ArmGrade) -> Iterator[str]:
    """A row for each camera."""
    for name, setup in cameras.items():
        board = "a board that lies still" if setup == EYE_IN_HAND else "a board in the hand"
        yield _wrapped(
            f"Camera {name}, {_PLACES[setup]}: it sees {board}. Without a key camera its lens is "
            "found from the same pictures.",
            "  # ",
        )
        yield f"""\
  - kind: {_PICTURES.kind}
    label: {_quoted(name)}
    target: {_quoted(f"seen by {name}")}
    setup: {setup}
    corners: {name}/corners.csv
    board: board.yaml
    samples: {name}/samples.csv"""
        if grade.hand_error:
            mm, deg = grade.hand_error
            yield f"""\
    # What the play of the joints leaves from picture to picture: standard deviations.
    hand_error: {{mm: {mm:g}, deg: {deg:g}}}"""


def _parameters(arm: AnyArm, grade: ArmGrade, *, pen: bool) -> Iterator[str]:
    """The rows of the job's ``parameters``: offsets, placements, and what would say both twice."""
    units = {arm.parameters[name].unit for name in arm.offsets}
    yield "  - select:"
    yield from (f"      - {_quoted(name)}" for name in arm.offsets)
    if "rad" in units:
        yield f"    prior_deg: {grade.offset_deg:g}"
    if "m" in units:
        yield f"    prior_mm: {grade.length_mm:g}"
    yield (
        f"  - {{select: geometric, prior_mm: {grade.length_mm:g}, prior_deg: {grade.tilt_deg:g}}}"
    )
    if arm.like_offsets:
        yield "  # A turn of a joint's frame about the joint's axis is the same as its offset."
        yield "  - select:"
        yield from (f"      - {_quoted(name)}" for name in arm.like_offsets)
        yield "    fixed: true"
    if pen:
        (tip,) = (chain.tip for chain in arm.chained)
        place, turn = ([_quoted(f"{tip}.{key}") for key in keys] for keys in (POSITION, ROTATION))
        yield "  # The point of the pen is somewhere in the hand. How the pen turns is no matter."
        yield f"  - {{select: [{', '.join(place)}], prior_mm: 50}}"
        yield f"  - {{select: [{', '.join(turn)}], fixed: true}}"


def _explained(folders: Mapping[tuple[str, str], tuple[str, str]]) -> Iterator[str]:
    """The rows of fitted samples, with what each kind is said once."""
    printed = set[str]()
    for (kind, chain), (folder, _) in folders.items():
        term = KINDS[kind]
        huber = {f"huber_{term.unit}": "1.35"} if term.unit else {}
        keys = _keys(kind, chain, folder) | huber
        if kind not in printed:
            yield _wrapped(f"{kind}: {term.about}", "  # ")
        printed.add(kind)
        first, *rest = (f"{key}: {value}" for key, value in keys.items())
        yield "\n    ".join([f"  - {first}", *rest])
        yield from (f"    # {line}" for line in term.begun)
        if finds_places(term):
            yield _POSE
        if term.medium != "touch":
            yield _CLOCK


def _row(kind: str, chain: str, folder: str) -> str:
    """A row of samples in one line."""
    row = _keys(kind, chain, folder)
    return f"  - {{{', '.join(f'{key}: {value}' for key, value in row.items())}}}"


def _keys(kind: str, chain: str, folder: str) -> dict[str, str]:
    """What a row says of its samples."""
    term = KINDS[kind]
    artefact = {"artefact": "artefact.yaml"} if term.needs_artefact else {}
    named = {Path(name).stem: name for name in term.files}
    of = {"chain": chain} if chain else {}
    return {"kind": kind, **of, **artefact, **named, "samples": f"'{folder}/*.csv'"}


def _wrapped(text: str, start: str) -> str:
    """Text as lines of a comment."""
    return textwrap.fill(
        text, 100, initial_indent=start, subsequent_indent=start, break_on_hyphens=False
    )


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


_PLACES: Final[Mapping[EyeSetup, str]] = {
    EYE_IN_HAND: "on the hand",
    EYE_TO_HAND: "beside the arm",
}
_POSE: Final = """\
    # Pose of the artefact in the arm's base frame, by a ruler. Without it the place of the base
    # cannot be estimated. Uncomment it, with your labels, numbers and standard deviations.
    # pose:
    #   P1: {position_mm: [170, 0, 0], rotation_rpy_deg: [0, 0, 0], prior_mm: 2, prior_deg: 1}"""
_CLOCK: Final = """\
    # For an arm that moves while it is seen: the samples need a column time, in s. How late what is
    # seen is beside the readings is then estimated, within this bound.
    # time_offset_ms: {bound: 100}"""
_CHAIN: Final = """\
# The arm: a URDF, and the link or frame whose pose matters. Every samples file needs one column
# per joint, in rad (m for prismatic joints), as the encoders report it:"""
_CHAINS: Final = """\
# The robot: a URDF, and its chains with the link or frame whose pose matters. Joints that chains
# share are one unknown. Every samples file needs one column per joint of its chain, in rad (m for
# prismatic joints), as the encoders report it. It may have those of other chains too: the key chain
# of its row says whose tip was measured. The joints of each chain:"""
_JOB: Final = """\
# One calibration job. Fill in the samples (and the artefact), then run
#   suta-calib observe calibration.yaml     what these data can and cannot determine
#   suta-calib calibrate calibration.yaml   calibrated.urdf, result.json, report.html
# Paths are relative to this file.

{arm}
{joints}
{grade}
# suta-calib init --grade writes such a job for another grade. The key grade is that of the parts:
# it sets the tolerance of all dimensions that are not estimated (certified, machined, printed).
arm: {{urdf: {urdf}, {ends}}}

# What is estimated: names or globs; later rows win. The word geometric means every placement
# (x, y, z in m, rx, ry, rz in rad) of every moving joint and of the tip. prior_mm, prior_deg:
# standard deviation of a value about nominal, a guess by the grade. The data correct this guess,
# unless fixed: true is beside it. bound_mm, bound_deg: largest difference from nominal.
# A parameter that the data do not determine stays near nominal, and is reported.
parameters:
{parameters}

# What was measured: any number of rows, of any kinds, solved together. huber_*: errors beyond it
# get less and less weight; leave it out for plain least squares. Samples determine most if the same
# place is touched or seen in different postures: tilt and turn the tool between two samples.
observations:
{rows}

# Samples that are never fitted: they show the error on new data.
validation:
{held_out}

# starts: the first is nominal, the others are drawn from the priors (seed: reproducible).
solver: {{starts: 8, seed: 0}}
"""
