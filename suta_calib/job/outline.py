"""A job before it is measured: its arm and its observations, whose samples need not exist yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.inputs import UrdfFile
from suta_calib.measurements import YamlSection, read_yaml
from suta_calib.measurements.fields import urdf_file
from suta_calib.model.robot import chosen_chain

_GROUPS: Final = ("observations", "validation")


@dataclass(frozen=True)
class PlannedObservation(Displayable):
    """One row of ``observations`` or ``validation``.

    Attributes:
        where: the row, such as ``observations[0]``.
        kind: of observation.
        samples: glob patterns of the files its samples are to be in.
        section: the row as it stands in the file.
    """

    where: str
    kind: str
    samples: tuple[str, ...]
    section: YamlSection

    @property
    def chain(self) -> str:
        """Of several chains the one that it is of."""
        return self.section.text("chain") if "chain" in self.section else ""

    @property
    def held_out(self) -> bool:
        """Whether it is for validation only."""
        return self.where.startswith("validation")

    def artefact(self) -> Path | None:
        """The artefact's file, or None where the row names none.

        Raises:
            JobError: there is no such file.
        """
        return self.section.existing_file("artefact") if "artefact" in self.section else None


@dataclass(frozen=True)
class JobOutline(Displayable):
    """What a ``calibration.yaml`` says beside its samples.

    Attributes:
        top: the file.
        ends: tip and base of its arm, base None for the root link; of several chains, by name.
        rows: what is to be observed, then what is to be held out.
        unknowns: names and globs of the parameters it looks for.
    """

    top: YamlSection
    ends: Mapping[str, tuple[str, str | None]]
    rows: tuple[PlannedObservation, ...]
    unknowns: tuple[str, ...]

    @classmethod
    def of(cls, top: YamlSection) -> JobOutline:
        """What a file that has been read is about.

        Raises:
            JobError: a key that is read here is missing or unusable.
        """
        arm = top.section("arm")
        rows = [
            PlannedObservation(f"{group}[{k}]", row.text("kind"), row.texts("samples"), row)
            for group in _GROUPS
            if group in top
            for k, row in enumerate(top.sections(group))
        ]
        selected = top.sections("parameters", 0) if "parameters" in top else []
        unknowns = [
            name
            for row in selected
            if not row.flag("fixed") or any(key.startswith("prior") for key in row.data)
            for name in row.texts("select")
        ]
        base = _base(arm)
        if "chains" in arm:
            chains = {name: arm.section("chains").section(name) for name in arm.data["chains"]}
            ends = {name: (c.text("tip"), _base(c) or base) for name, c in chains.items()}
        else:
            ends = {"": (arm.text("tip"), base)}
        return cls(top, ends, tuple(rows), tuple(unknowns))

    def one(self, chain: str = "") -> tuple[str, str | None]:
        """Tip and base of the arm, or of the chain of this name (`ArmSpec.one`)."""
        return self.ends[chosen_chain(self.ends, chain)]

    def urdf(self) -> UrdfFile:
        """The arm's URDF.

        Raises:
            JobError: there is no such file.
        """
        return urdf_file(self.top.section("arm"), "urdf")


def _base(arm: YamlSection) -> str | None:
    return arm.text("base") if "base" in arm else None


def read_outline(path: Path) -> JobOutline:
    """Read what a job is about.

    Args:
        path: a ``calibration.yaml``; the artefacts and samples it names need not exist.

    Raises:
        JobError: the file cannot be read, or a key that is read here is missing or unusable.
    """
    return JobOutline.of(YamlSection(read_yaml(Path(path), JobError), JobError))
