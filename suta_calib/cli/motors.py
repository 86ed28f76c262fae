"""``suta-calib motors``: which motor moves which joint, from touches of a sheet."""

from __future__ import annotations

from pathlib import Path

from suta_calib.acquisition.motor_mapping import map_motors
from suta_calib.acquisition.motor_search import MotorMapOptions
from suta_calib.acquisition.remapped_samples import remapped
from suta_calib.atomic import check_outputs
from suta_calib.cli._options import PATH, WRITTEN, Folder, job_argument, option
from suta_calib.cli._output import answer_command
from suta_calib.device.device_file import device_text, read_device
from suta_calib.errors import InputError
from suta_calib.job.job_terms import read_term
from suta_calib.job.schema import read_job
from suta_calib.measurements.files import write_text
from suta_calib.model.arm import ArmModel
from suta_calib.report.document import Document
from suta_calib.report.motors import motors_document
from suta_calib.terms import KINDS


def _signs(given: tuple[str, ...]) -> dict[str, int]:
    """Known signs by joint, of words JOINT=1,JOINT=-1."""
    signs = dict[str, int]()
    for word in (part for text in given for part in text.split(",")):
        name, _, number = word.partition("=")
        if number not in ("1", "-1", "+1"):
            raise InputError(repr(word), "JOINT=1 or JOINT=-1", where="--sign")
        signs[name] = int(number)
    return signs


@answer_command
@job_argument
@option("--device", "The device.yaml with which the touches were read.", PATH, required=True)
@option(
    "--sign JOINT=1|-1",
    "Direction of a joint that you know: 1 if it is as in device.yaml.",
    name="given",
    multiple=True,
)
@option("--out FILE", "The corrected device.yaml to write.", WRITTEN, name="file")
@option(
    "--samples-out FOLDER",
    "Folder for the samples of the job as the corrected device would have given them.",
    Folder(),
)
def motors(
    job: Path,
    device: Path,
    given: tuple[str, ...],
    file: Path | None,
    samples_out: Path | None,
) -> Document:
    """Find which motor moves which joint of JOB, in which direction and from which zero.

    The touches of the job's sheet or artefact decide: under each order of the motors and all
    directions the arm is fitted to them. Fifteen touches of a printed sheet in two places suffice
    for an arm of five joints, if the tip is 30 mm or more beside the axis of the last joint and the
    hand is turned between the touches. The zero of the first joint shows only if the job states the
    pose of the sheet. If two motors may be exchanged, or a direction is open, the answer says so,
    nothing is written, and the exit code is 1.
    """
    asked = read_job(job)
    arm = asked.arm.mechanism(asked.pairs)
    if not isinstance(arm, ArmModel):
        raise InputError("a robot of several chains", "an arm of one chain", file=job)
    # Other rows may be measured later.
    rows = [row for row in asked.observations if KINDS[row.kind].needs_artefact]
    touches = [read_term(arm, row, job) for row in rows]
    spec = read_device(device)
    inputs = [job, device, *(path for row in rows for path in row.sample_files)]
    check_outputs([] if file is None else [file], inputs)
    unknowns = arm.select(*asked.parameters)
    tip = [f"{arm.tip}.{axis}" for axis in "xyz"]
    stds = [unknowns[name].prior or 0.0 for name in tip if name in unknowns]
    options = MotorMapOptions(_signs(given), max([MotorMapOptions().tip_std, *stds]))
    mapping = map_motors(arm, touches, spec, options)
    written: dict[str, Path | None] = {"device": None, "samples": None}
    if mapping.assessment.usable and file is not None:
        comment = f"From {device.name}, with motors and joints as the touches of {job} show them."
        write_text(file, device_text(mapping.corrected, comment))
        written["device"] = file
    if mapping.assessment.usable and samples_out is not None:
        every = (*asked.observations, *asked.validation)
        texts = remapped(mapping, job, [path for row in every for path in row.sample_files])
        check_outputs([samples_out / name for name in texts], inputs)
        for name, text in texts.items():
            (samples_out / name).parent.mkdir(parents=True, exist_ok=True)
            write_text(samples_out / name, text)
        written["samples"] = samples_out
    return motors_document(mapping, written)
