"""What writes a foreign format: `Writer`, one file each in ``writers/``."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

from suta_calib.assessment import Assessment, judged
from suta_calib.atomic import exchange_files
from suta_calib.display import Displayable
from suta_calib.exchange.option import Described, Given, formats_of, named
from suta_calib.exchange.result import CalibratedArm, Result, json_bytes
from suta_calib.words import listed

# Behind the name of an exported file: what its format cannot hold.
BESIDE: Final = ".left_out.json"


class Writer(Described, ABC):
    """One foreign format that can be written.

    A new one is a module in ``writers/`` with a subclass, or an entry point of another package in
    the group ``suta_calib.writers``; nothing else names it.

    Attributes:
        file: name of the file where none is given.
        holds_covariance: whether it says how sure the values are.
        holds_everything: whether it holds what is no geometry too: gains, eccentricities,
            compliances, bending, backlash, couplings.
        notes: what whoever uses the file must know, one sentence each.
    """

    file: ClassVar[str]
    holds_covariance: ClassVar[bool] = False
    holds_everything: ClassVar[bool] = False
    notes: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def content(self, result: Result, given: Given) -> bytes:
        """The file.

        Raises:
            InputError: the result holds nothing of this format, or an option cannot be used.
        """

    def more(self, result: Result, given: Given) -> Mapping[str, bytes]:
        """Further files, as of further cameras, by what is put behind the name of the first."""
        del result, given
        return {}

    def lost(self, arm: CalibratedArm) -> list[str]:
        """Names of the arm's values that differ from nominal and that the format cannot hold."""
        return [] if self.holds_everything else list(arm.calibration.beside_geometry)

    def care(self, arm: CalibratedArm) -> tuple[str, ...]:
        """What of this arm the user must do by hand, one sentence each."""
        del arm
        return ()


@dataclass(frozen=True, eq=False)
class Exported(Displayable):
    """A result in a foreign format.

    Attributes:
        result: what it was made from.
        form: name of the format.
        content: of the file.
        more: contents of further files, by what is put behind its name.
        file: its usual name.
        left_out: what the format cannot hold, as JSON; empty where it holds all.
        lost: names of values that it cannot hold.
        notes: what whoever uses the file must know, one sentence each.
        care: what whoever uses it must do by hand, one sentence each.
    """

    result: Result
    form: str
    content: bytes
    more: Mapping[str, bytes]
    file: str
    left_out: Mapping[str, Any]
    lost: Sequence[str]
    notes: tuple[str, ...] = ()
    care: tuple[str, ...] = ()

    @cached_property
    @judged
    def assessment(self) -> Assessment:
        """Care where values are lost, or the result must not be used; then it was insisted on."""
        care = []
        if not self.result.usable:
            care.append("The verdict of this result is bad: do not use it.")
        if self.lost:
            names = listed(list(self.lost))
            care.append(
                f"{self.form} cannot contain {names}. Without these values the arm is a "
                "different one."
            )
        care.extend(self.care)
        facts = list(self.notes)
        if "covariance" in self.left_out:
            facts.append(f"{self.form} cannot contain the covariance.")
        return Assessment.of(f"exported as {self.form}", care=care, facts=facts)

    def write(self, path: str | Path) -> list[Path]:
        """Write the file, and beside it what its format cannot hold, all or none.

        Returns:
            The files written, those of the format first.

        Raises:
            OutputError: a file cannot be written.
        """
        path = Path(path)
        beside = path.with_name(f"{path.name}{BESIDE}")
        names = [re.sub(r"[^-.\w]", "_", name) for name in self.more]
        further = {
            f"{path.stem}-{name}{path.suffix}": content
            for name, content in zip(names, self.more.values(), strict=True)
        }
        contents = {path.name: self.content, **further}
        stale = () if self.left_out else (beside.name,)
        if self.left_out:
            contents = {beside.name: json_bytes(self.left_out), **contents}
        files = [path, *(path.with_name(name) for name in further)]
        exchange_files(path.parent, contents, [name for name in stale if beside.is_file()])
        return [*files, beside] if self.left_out else files


def export_formats() -> dict[str, Writer]:
    """Every format that can be written, by name."""
    return formats_of("writers", "suta_calib.exchange.writers", Writer)


def write_foreign(result: Result, form: str, **options: Any) -> Exported:
    """A result as another program reads it.

    Args:
        result: `read_result` reads one.
        form: name of the format.
        **options: the format's own, by name, as on the command line.

    Returns:
        The file's content, and what it cannot hold; ``.write(path)`` writes them.

    Raises:
        InputError: no such format or option, or a result that holds nothing of this format.
        MissingExtraError: the format needs a package that is not installed.
    """
    writer = named(export_formats(), form)
    given = Given(writer.options, options, writer.name)
    content, more = writer.content(result, given), writer.more(result, given)
    left_out: dict[str, Any] = {}
    lost: list[str] = []
    care: tuple[str, ...] = ()
    if result.arm is not None:
        lost, care = writer.lost(result.arm), writer.care(result.arm)
        left_out = {name: result.arm.values[name] for name in lost}
        left_out = {"parameters": left_out} if lost else {}
        if not writer.holds_covariance and result.arm.calibration.names:
            left_out["covariance"] = covariance_record(result.arm)
    notes = writer.notes
    if more:
        first, *others = result.cameras
        notes = (*notes, f"The file is of camera {first}; beside it are files of {listed(others)}.")
    return Exported(result, form, content, more, writer.file, left_out, lost, notes, care)


def covariance_record(arm: CalibratedArm) -> dict[str, Any]:
    """The covariance of an arm's parameters as JSON has it: names, unit, matrix."""
    calibration = arm.calibration
    return {
        "parameters": list(calibration.names),
        "unit": "m, rad",
        "matrix": calibration.covariance.tolist(),
    }
