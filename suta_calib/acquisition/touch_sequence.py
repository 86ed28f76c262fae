"""What is to be measured: the stations of one placement or point, as a job asks for them.

The job is read for its arm and one of its observations only: the samples it names need not exist
yet, for they are what is measured here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from suta_calib.arm_keys import CHAIN_KEYS
from suta_calib.arm_keys import read_arm as read_arm_of_job
from suta_calib.errors import InputError, JobError, did_you_mean
from suta_calib.inputs import UrdfFile
from suta_calib.job.outline import read_outline
from suta_calib.job.schema import given_poses
from suta_calib.measurements import Artefact, read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.model.robot import chosen_chain
from suta_calib.terms import KINDS, Term
from suta_calib.terms.given_pose import GivenPose
from suta_calib.terms.seating import ALWAYS_ALIKE

# What is touched again and again at one and the same place: `TouchSequence.place`.
ONE_POINT: Final = ("point",)
_WHICH: Final = re.compile(r"(?:(observations|validation)(?:\[(\d+)\])?|(\d+))")


@dataclass(frozen=True)
class Station:
    """One sample to be taken: what the user is told to go to, and cells of the label columns."""

    name: str
    labels: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class ObservationRow:
    """One observation of a job.

    Attributes:
        job: the job's file.
        where: the row, such as ``observations[0]``.
        kind: of observation.
        artefact: for the kinds that need one.
        pattern: the first glob of its samples.
        seated: whether how the tip sits in its sockets is to be found, so that it must always be
            the same.
        chain: of several chains its own, and the one from whose tip it is touched.
        settings: values of the kind's own keys.
        given: poses of places that the row states, by label.
    """

    job: Path
    where: str
    kind: str
    artefact: Artefact | None
    pattern: str
    seated: bool = False
    chain: tuple[str, str] = ("", "")
    settings: Mapping[str, Any] = field(default_factory=dict)
    given: Mapping[str, GivenPose] = field(default_factory=dict)

    def file(self, label: str, repeat: str) -> Path:
        """Where samples of this label go by default: the folder and the look of the glob."""
        named, stem = Path(self.pattern), f"{label}_{repeat}"
        fixed = list(takewhile(lambda part: not re.search(r"[*?\[]", part), named.parts))
        if len(fixed) == len(named.parts):
            return self.job.parent / named
        plain = named.name.count("*") == 1 and not re.search(r"[?\[]", named.name)
        name = named.name.replace("*", stem) if plain else f"{stem}.csv"
        return self.job.parent.joinpath(*fixed) / name


@dataclass(frozen=True, eq=False)
class TouchSequence:
    """What to measure with which arm.

    Attributes:
        arm: at nominal.
        artefact: certified landmarks, or None.
        stations: in order.
        key: labels that all stations share: they tell one run's rows from another's.
        how: what must be done at every station beside going there; or empty.
        twist: which way the plug must be turned at last, ``ccw`` or ``cw``; or empty.
        place: the column of what is touched, where that is no landmark.
    """

    arm: ArmModel
    artefact: Artefact | None
    stations: tuple[Station, ...]
    key: Mapping[str, str]
    how: str = ""
    twist: str = ""
    place: tuple[str, ...] = ()

    @property
    def label_columns(self) -> tuple[str, ...]:
        """Columns beside the joints'."""
        return tuple(self.key) if self.artefact is None else (*self.key, "landmark")


def read_arm(
    job: Path, urdf: UrdfFile | None = None, chain: tuple[str, str] = ("", "")
) -> ArmModel:
    """The arm of a job, or the same chain of another URDF; errors as of `CalibrationJob.load`.

    ``chain`` is that of a row, where the robot has several: `ObservationRow.chain`.
    """
    return read_arm_of_job(read_outline(job).top, urdf).model(*chain)


def read_row(
    job: Path, which: str | None, usable: Sequence[str], chain: str = ""
) -> ObservationRow:
    """The observation that samples are taken for: the first of a kind that is ``usable``.

    Or the one that ``which`` names: ``1``, ``observations[1]``, ``validation[0]`` or a kind. Where
    there is none, or a key of it or its artefact cannot be used, a JobError or ArtefactError. Of
    several chains of a robot, the one of this name; which need not be said of a row that is named.
    """
    outline = read_outline(job)
    if chain or which is None or not _WHICH.fullmatch(which):
        chain = chosen_chain(outline.ends, chain)
    rows = {row.where: row for row in outline.rows if chain in ("", row.chain)}
    name = _chosen(job, {name: row.kind for name, row in rows.items()}, which, usable)
    row = rows[name]
    file = row.artefact()
    if file is None and row.kind in KINDS and KINDS[row.kind].needs_artefact:
        raise row.section.refuse("nothing", "the artefact's file", at=("artefact",))
    artefact = None if file is None else read_artefact(file)
    seated, read = "seating" in row.section, CHAIN_KEYS.values(row.section)
    ends = read.get("chain", ""), read.get("base_chain", "")
    kind = KINDS.get(row.kind)
    settings = {} if kind is None else kind.read_settings(row.section)
    given = {}
    if kind is not None and kind.place and "pose" in row.section:
        given = given_poses(row.section, kind)
    return ObservationRow(
        *(job, name, row.kind, artefact, row.samples[0], seated, ends, settings, given)
    )


def _chosen(job: Path, kinds: Mapping[str, str], which: str | None, usable: Sequence[str]) -> str:
    if which is None:
        chosen = next((name for name, kind in kinds.items() if kind in usable), None)
        expected = f"an observation of kind {' or '.join(usable)}"
    else:
        if (matched := _WHICH.fullmatch(which)) is None:
            chosen = next((name for name, kind in kinds.items() if kind == which), None)
        else:
            name = f"{matched[1] or 'observations'}[{matched[3] or matched[2] or 0}]"
            chosen = name if name in kinds else None
        expected = f"one of {', '.join(f'{name} ({kind})' for name, kind in kinds.items())}"
    if chosen is None:
        listed = ", ".join(dict.fromkeys(kinds.values())) or "none"
        raise JobError(
            f"observations of kind {listed}" if which is None else repr(which),
            expected,
            file=job,
            where="observations" if which is None else "--observation",
            hint="" if which is None else did_you_mean(which, kinds.values()),
        )
    return chosen


def touched(
    arm: ArmModel, row: ObservationRow, placement: str, repeat: str, sequence: Sequence[str] | None
) -> TouchSequence:
    """The landmarks of one placement, in the artefact's order or another one.

    A landmark that there is not is an ArtefactError, an empty sequence an InputError.
    """
    assert row.artefact is not None
    names = list(row.artefact.landmarks) if sequence is None else list(sequence)
    if not names:
        raise InputError("no landmarks", "landmarks such as O,M1,M2", where="--sequence")
    for name in names:
        row.artefact.landmark(name)
    key = {"placement": checked_label(placement, "--placement"), "repeat": repeat}
    stations = tuple(Station(name, key | {"landmark": name}) for name in names)
    # A plug whose seating is to be found must be turned alike everywhere; the thesis that the
    # key is from turned it counter-clockwise.
    twist = row.artefact.twist or ("ccw" if row.seated else "")
    how = ALWAYS_ALIKE[twist] if twist else ""
    return TouchSequence(arm, row.artefact, stations, key, how, twist)


def repeated(
    arm: ArmModel, kind: type[Term] | None, label: str | None, repeat: str, count: int
) -> TouchSequence:
    """A number of rests: all on what one label of a kind means, or anywhere (no kind, no label)."""
    key = {"repeat": repeat}
    if kind is not None and label is not None:
        key = {kind.place: checked_label(label, place_option(kind))} | key
    where = "anywhere" if label is None else label
    stations = tuple(Station(f"{where}, rest {k + 1}", key) for k in range(count))
    return TouchSequence(arm, None, stations, key, place=tuple(key)[:-1])


def place_option(kind: type[Term]) -> str:
    """The flag that names what is touched, such as ``--placement``; empty where nothing is."""
    return f"--{kind.place}" if kind.place else ""


def kinds_of(place: str) -> tuple[str, ...]:
    """Names of the kinds that touch such places."""
    return tuple(kind.kind for kind in KINDS.values() if kind.place == place)


def checked_label(label: str, option: str) -> str:
    """A label; refused with an InputError where it cannot stand in a cell and in a file's name."""
    if not label.strip() or not label.isprintable() or "/" in label or label.strip() != label:
        raise InputError(repr(label), "a label without slashes or blanks around it", where=option)
    return label
