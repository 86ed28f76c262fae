"""The files a new job starts from: commented, with the arm's own joint names."""

from __future__ import annotations

import csv
import io
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from suta_calib.errors import JobError, OutputError
from suta_calib.measurements import write_text
from suta_calib.measurements.csv_table import rotation_columns
from suta_calib.measurements.sample_files import check_joint_names
from suta_calib.model.arm import ArmModel
from suta_calib.terms import KINDS, first_kind

DEFAULT_KINDS: Final = tuple(first_kind(artefact=on_it).kind for on_it in (True, False))
_ARTEFACT: Final = """\
# The artefact's landmarks as certified; the numbers below are an example: put in your own.
# position_mm: where the tip's origin is when it is seated there, in the artefact's frame.
# Optional: rotation_rpy_deg (the tip frame's orientation in the artefact when seated, roll pitch
# yaw as in URDF) and sigma_mm (standard deviation of each coordinate).
name: my artefact
landmarks:
  A: {position_mm: [0, 0, 40], sigma_mm: 0.01}
  B: {position_mm: [100, 0, 40], sigma_mm: 0.01}
  C: {position_mm: [0, 120, 60], sigma_mm: 0.01}
  D: {position_mm: [90, 110, 20], sigma_mm: 0.01}
"""


class Template(NamedTuple):
    """One file of a new job: where it goes, and its whole content."""

    path: Path
    text: str


def new_job(
    urdf: Path,
    tip: str,
    folder: Path,
    *,
    base: str | None = None,
    kinds: Sequence[str] = DEFAULT_KINDS,
) -> tuple[Template, ...]:
    """Files of a job for an arm; nothing is written yet.

    Args:
        urdf: of the arm.
        tip: link or frame to calibrate.
        folder: where the job will be.
        base: link the chain starts from; the root link by default.
        kinds: of observation, each once.

    Returns:
        ``calibration.yaml``, ``artefact.yaml`` and what else a kind needs, and empty samples files.

    Raises:
        UrdfError: the URDF has no usable chain to the tip.
        JobError: a kind is not known or given twice.
        SamplesError: a joint is called as a column of one of the kinds.
    """
    arm = ArmModel.from_urdf(urdf, tip, base)
    for kind in kinds:
        if kind not in KINDS:
            raise JobError(f"kind '{kind}'", f"one of {', '.join(KINDS)}", where="--kind")
        if kinds.count(kind) > 1:
            raise JobError(f"kind '{kind}' twice", "each kind once", where="--kind")
    # Of the samples to fit and of those held out: only the first kind is validated.
    first, *further = kinds
    folders: dict[str, tuple[str, str | None]] = {first: ("calibration", "validation")}
    folders |= {kind: (kind, None) for kind in further}
    files = [Template(folder / "calibration.yaml", _job(arm, urdf, folder, base, folders))]
    if any(KINDS[kind].needs_artefact for kind in kinds):
        files.append(Template(folder / "artefact.yaml", _ARTEFACT))
    begun = {name: text for kind in kinds for name, text in KINDS[kind].files.items()}
    files += [Template(folder / name, text) for name, text in begun.items()]
    for kind, ends in folders.items():
        columns, header = KINDS[kind].columns, io.StringIO()
        check_joint_names(arm.joints, columns)
        oriented = rotation_columns() if columns.orientation == "required" else ()
        measured = (*"xyz", *oriented) if columns.position else ()
        names = (
            *columns.labels,
            *measured,
            *(number.name for number in columns.numbers),
            *arm.joints,
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
    arm: ArmModel,
    urdf: Path,
    folder: Path,
    base: str | None,
    folders: dict[str, tuple[str, str | None]],
) -> str:
    rows = "\n".join(_row(kind, fitted, explain=True) for kind, (fitted, _) in folders.items())
    held_out = "\n".join(_row(k, v, explain=False) for k, (_, v) in folders.items() if v)
    start = "" if base is None else f", base: {_quoted(base)}"
    return _JOB.format(
        urdf=_quoted(Path(os.path.relpath(urdf, folder)).as_posix()),
        tip=_quoted(arm.tip),
        base=start,
        joints=", ".join(arm.joints),
        offsets="\n".join(f"      - {_quoted(name)}" for name in arm.offsets),
        rows=rows,
        held_out=held_out,
    )


def _row(kind: str, folder: str, *, explain: bool) -> str:
    artefact = ", artefact: artefact.yaml" if KINDS[kind].needs_artefact else ""
    named = "".join(f", {Path(name).stem}: {name}" for name in KINDS[kind].files)
    huber = f", {f'huber_{KINDS[kind].unit}'.rstrip('_')}: 1.35" if explain else ""
    row = f"  - {{kind: {kind}{artefact}{named}, samples: '{folder}/*.csv'{huber}}}"
    width = 100
    comment = textwrap.wrap(
        f"{kind}: {KINDS[kind].about}",
        width,
        initial_indent="  # ",
        subsequent_indent="  # ",
        break_on_hyphens=False,
    )
    return "\n".join([*comment, row]) if explain else row


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


_JOB: Final = """\
# One calibration job. Fill in the samples (and the artefact), then run
#   suta-calib observe calibration.yaml     what these data can and cannot determine
#   suta-calib calibrate calibration.yaml   calibrated.urdf, result.json, report.html
# Paths are relative to this file.

# The arm: a URDF, and the link or frame whose pose matters. Every samples file needs one column
# per joint, in rad (m for prismatic joints), as the encoders report it:
#   {joints}
arm: {{urdf: {urdf}, tip: {tip}{base}}}

# What is unknown: names or globs; later rows win. The word geometric stands for every placement
# (x, y, z in m, rx, ry, rz in rad) of every moving joint and of the tip. bound_*: how far from
# nominal a value may be. prior_mm, prior_deg: how far it is likely to be (standard deviation); the
# data correct it, unless fixed: true stands beside it.
# What the data cannot determine is held at nominal and reported.
parameters:
  - select:
{offsets}
    bound_deg: 15
  - {{select: geometric, bound_mm: 30, bound_deg: 5}}

# What was measured: any number of rows, of any kinds, solved together. huber_*: errors beyond it
# are believed less and less; leave it out for plain least squares.
observations:
{rows}

# Samples that are never fitted: how good the result is on data it has not seen.
validation:
{held_out}

# starts: the first is nominal, the others are drawn within the bounds (seed: reproducible).
solver: {{starts: 8, seed: 0}}
"""
