"""``suta-calib iso10360``: acceptance test of an articulated arm."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.analysis.iso10360 import acceptance_test
from suta_calib.cli._options import PATH, Folder, option, urdf_option
from suta_calib.cli._output import answer_command
from suta_calib.inputs import UrdfFile
from suta_calib.job.acceptance import AcceptanceJob
from suta_calib.report.document import Document
from suta_calib.report.iso10360 import acceptance_document


@answer_command
@click.argument("job", type=PATH, metavar="JOB.yaml")
@urdf_option("In place of the job's own, such as calibrated.urdf.")
@option("--out", "Folder for iso10360.json, its picture and report.html.", Folder())
def iso10360(job: Path, urdf: UrdfFile | None) -> Document:
    """Errors of a measuring arm against maximum permissible errors, after ISO 10360-12.

    JOB.yaml says which arm, what was measured (lengths of a calibrated artefact, one point from
    several articulations, a sphere, repeated visits), the limits (mpe) and what the test itself is
    unsure of. A calibration.yaml will do too: its held-out distances and fixed points are taken,
    and there is no pass or fail. Exits with 1 where a limit is broken, or where the uncertainty
    leaves it open.
    """
    loaded = AcceptanceJob.load(job, urdf)
    answer = acceptance_document(acceptance_test(loaded))
    return answer.with_data(urdf=str(loaded.arm.chain.path), job=str(job))
