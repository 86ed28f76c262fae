"""Denavit-Hartenberg tables, classic or modified."""

from __future__ import annotations

from typing import Final, cast, get_args

from suta_calib.errors import InputError
from suta_calib.exchange.option import Given, Option
from suta_calib.exchange.result import Result
from suta_calib.exchange.writer import Writer
from suta_calib.job.dh_file import dh_text
from suta_calib.model.dh import Convention, dh_table

CONVENTION: Final = Option(
    "convention", "Convention of a and alpha.", choices=tuple(get_args(Convention))
)


class DhWriter(Writer):
    """A table of the calibrated chain, in mm and degrees."""

    name = "dh"
    summary = "Denavit-Hartenberg table as CSV, classic or modified (Craig)"
    example = "results --format dh --convention modified --out arm_dh.csv"
    options = (CONVENTION,)
    file = "exported_dh.csv"

    def content(self, result: Result, given: Given) -> bytes:
        """The table; the offsets are part of theta (of d for a slide)."""
        arm = result.need_arm(self.name)
        alone = arm.alone
        unsupported = [j.name for j in alone.chain.joints if j.moving and (j.climbed or j.mimic)]
        if unsupported:
            problem = (
                f"{unsupported[0]}, which mimics another joint or is passed from its child to "
                "its parent"
            )
            expected = "a serial chain in which each joint has its own reading"
            raise InputError(problem, expected, file=alone.chain.path)
        convention = cast(Convention, given.text(CONVENTION, "classic"))
        return dh_text(dh_table(alone, arm.values, convention)).encode()
