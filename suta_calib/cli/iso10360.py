"""``suta-calib iso10360``: acceptance test of an articulated arm."""

from __future__ import annotations

from pathlib import Path

import click

from suta_calib.analysis.iso10360 import acceptance_test
from suta_calib.cli._options import PATH, Folder, chain_option, option, urdf_option
from suta_calib.cli._output import answer_command
from suta_calib.inputs import UrdfFile
from suta_calib.job.acceptance import AcceptanceJob
from suta_calib.report.document import Document
from suta_calib.report.iso10360 import acceptance_document


@answer_command
@click.argument("job", type=PATH, metavar="JOB.yaml")
@chain_option
@urdf_option("URDF to test instead of the job's, such as calibrated.urdf.")
@option("--out", "Folder for iso10360.json, its picture and report.html.", Folder())
def iso10360(job: Path, chain: str, urdf: UrdfFile | None) -> Document:
    """Compare the errors of a measuring arm with its limits, by ISO 10360-12.

    JOB.yaml contains the arm, the measurements (lengths of a calibrated artefact, one point from
    several articulations, a sphere, repeated visits), the limits (mpe) and the uncertainty of the
    test. A calibration.yaml can be used too: then its validation distances and fixed points are
    taken, without pass or fail. The exit code is 1 if a limit is exceeded, or if the uncertainty
    does not allow a decision.
    """
    loaded = AcceptanceJob.load(job, urdf, chain)
    answer = acceptance_document(acceptance_test(loaded))
    return answer.with_data(urdf=str(loaded.arm.chain.path), job=str(job))
