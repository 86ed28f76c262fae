"""``calibration.yaml`` as typed data: SI units, paths resolved, every key checked.

What a job means (which parameters a name selects, which samples fit the arm) is checked where
it is known. Here every key is known, every value usable and every file there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, get_args

from suta_calib.arm_keys import ROBOTS, ArmSpec, CellRobot, read_arm
from suta_calib.display import Displayable
from suta_calib.errors import JobError
from suta_calib.job.keys import BOUND_AND_PRIOR_KEYS, COMMON_KEYS, OBSERVATION_KEYS, SELECTION_KEYS
from suta_calib.measurements.exclusion import Exclusion
from suta_calib.measurements.fields import (
    ANGLE_OR_0,
    LENGTH_OR_0,
    Field,
    Fields,
    Value,
    bits,
    choice,
    fields_of,
    keyed,
    mapping,
    read_as,
    rows,
    whole_number,
)
from suta_calib.measurements.files import in_empty_folder
from suta_calib.measurements.scale import SCALE_KEYS, LengthScale
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.model.parameters import Selection
from suta_calib.terms import KINDS, GivenPose, Seating, Term
from suta_calib.terms.clock import TimeOffset
from suta_calib.terms.given_pose import POSE_KEYS
from suta_calib.trust.rule import Rule

_ANGLE_KEYS: Final = ("huber_deg", "sigma_deg")
_LENGTH_KEYS: Final = ("huber_mm", "sigma_mm")

Hessian = Literal["gauss-newton", "exact"]


@dataclass(frozen=True)
class ObservationSpec(Displayable):
    """One term: a row of a job's ``observations`` or ``validation`` (`keys.COMMON_KEYS`), in SI.

    Attributes:
        samples: glob patterns as written in the job.
        sample_files: the files they match, each once, in the order of the patterns; none where
            validation has a folder in which nothing is yet.
        sigma_fixed: whether the data have no say in the standard deviations.
        line: line of the row in the job file.
        settings: what the kind's own keys say, as it has read them.
        given: what is known beforehand of where things stand, as `Term.given`.
        scale: how well the scale of the lengths is known that an instrument measures; None where
            the row says nothing of it.
        chain: whose samples they are, where the arm has several chains.
        base_chain: the chain from whose tip it is seen; empty for its own base.
        link: what carries what is seen; empty for the tip. In a job that was read, ``chain`` is
            then the chain to this link.
        time_offset: what is known of the clock of what sees; None where it has that of the arm.
        time: whether the samples must say when they were taken; else they may.
    """

    kind: str
    samples: tuple[str, ...]
    sample_files: tuple[Path, ...]
    artefact: Path | None = None
    label: str = "default"
    huber_m: float | None = None
    huber_rad: float | None = None
    sigma_m: float | None = None
    sigma_rad: float | None = None
    sigma_fixed: bool = False
    line: int | None = None
    exclude: Exclusion | None = None
    seating: Seating | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    given: Mapping[str, GivenPose] = field(default_factory=dict)
    scale: LengthScale | None = None
    chain: str = ""
    base_chain: str = ""
    link: str = ""
    time_offset: TimeOffset | None = None
    time: bool = True


@dataclass(frozen=True)
class SolverSpec(Displayable):
    """How to solve: the key ``solver`` of a job."""

    # What has no minimum by the most has none: 8 starts and 200 iterations are usual.
    starts: int = keyed(
        whole_number(1, 1000), "Number of starts; the first is nominal. 1 without it.", 1
    )
    seed: int = keyed(whole_number(0), "Seed of the random numbers for the other starts.", 0)
    hessian: Hessian = keyed(
        choice(get_args(Hessian)),
        "gauss-newton (the default), or exact: second derivatives by automatic differentiation.",
        "gauss-newton",
    )
    max_iterations: int = keyed(whole_number(1, 100_000), "Iterations per start.", 200)


@dataclass(frozen=True)
class EncoderSpec:
    """What is known of the encoders beforehand: the key ``encoders`` of a job."""

    bits: int | None = keyed(
        bits(1), "A revolute joint reads whole steps of a turn over 2^bits.", None
    )
    noise_rad: float = keyed(
        ANGLE_OR_0,
        "Standard deviation of a revolute joint's reading, without the steps.",
        0.0,
        "noise_deg",
    )
    noise_m: float = keyed(LENGTH_OR_0, "The same for a prismatic joint.", 0.0, "noise_mm")


def _selection(row: YamlSection) -> Selection:
    values = SELECTION_KEYS.read(row)
    sizes = BOUND_AND_PRIOR_KEYS.names
    priors = [key for key in sizes if key.startswith("prior") and key in row]
    for key in sizes:
        # A prior that is fixed is one whose size the data do not change.
        if values.get("fixed") and not priors and key in row:
            raise row.refuse(f"{key} beside fixed: true", "one or the other", at=(key,))
    return Selection(**values, line=row.line)


def _held_out(row: YamlSection) -> ObservationSpec:
    return _observation(row, filled=False)


def _observation(row: YamlSection, *, filled: bool = True) -> ObservationSpec:
    kind = _kind(row)
    patterns = row.texts("samples")
    empty = not filled and all(in_empty_folder(p, row.document.path.parent) for p in patterns)
    files = patterns, () if empty else row.files("samples")
    values = COMMON_KEYS.values(row)
    sigma_key = f"sigma_{kind.unit}".rstrip("_")
    levels = ("sigma_mm", "sigma_deg") if kind.unit == "mm" else (sigma_key,)
    if values.get("sigma_fixed") and not any(level in row for level in levels):
        raise row.refuse(
            "fixed: true without a noise level", f"{' or '.join(levels)} beside it", at=("fixed",)
        )
    if "seating" in values and values["seating"].rotation and not kind.has_angles:
        raise row.refuse(
            f"a key that {kind.kind} does not use",
            at=("seating", "rotation_deg"),
            hint="remove it: distances do not depend on the tip's orientation",
        )
    settings, given = kind.read_settings(row), given_poses(row, kind)
    return ObservationSpec(
        kind.kind, *files, line=row.line, settings=settings, given=given, **values
    )


def given_poses(row: YamlSection, kind: type[Term]) -> dict[str, GivenPose]:
    """``pose`` of the only place or of what sees, or poses by label; and frames by their keys."""
    keys = [frame.key for frame in kind.frames if frame.key in row]
    given = {key: GivenPose.read(row.section(key)) for key in keys}
    if "pose" not in row:
        return given
    if keys:
        raise row.refuse(f"pose beside {keys[0]}", "one or the other", at=("pose",))
    poses = row.section("pose")
    if any(key in poses for key in POSE_KEYS.names):
        return given | {"": GivenPose.read(poses)}
    return given | {str(label): GivenPose.read(poses.section(label)) for label in poses.data}


def _kind(row: YamlSection) -> type[Term]:
    """The kind of a row whose keys it has a use for."""
    name = row.data.get("kind")
    kind = KINDS[name] if isinstance(name, str) and name in KINDS else None
    if kind is None or not {*_needed(kind)} <= {*row.data} <= _useful(kind):
        # Something is wrong: only to say what, all kinds are asked for their keys.
        OBSERVATION_KEYS.check(row)
        kind = KINDS[row.choice("kind", KINDS)]
        _check_keys_of_kind(row, kind)
    return kind


def _needed(kind: type[Term]) -> tuple[str, ...]:
    """Keys that a row of the kind must have."""
    artefact = ("artefact",) if kind.needs_artefact else ()
    return (*COMMON_KEYS.required, *artefact, *Fields(*kind.keys).required)


def _useful(kind: type[Term]) -> set[str]:
    """Keys that a row of the kind may have: its own, and those common to all that it can use."""
    useful = {*COMMON_KEYS.names}
    useful -= set() if kind.needs_artefact else {"artefact", "seating"}
    useful -= set() if kind.has_angles else {*_ANGLE_KEYS}
    useful -= set() if kind.unit == "mm" else {*_LENGTH_KEYS}
    useful -= set() if kind.measures_lengths() else {*SCALE_KEYS.names}
    useful -= {"time_offset_ms"} if kind.medium == "touch" else set()
    return useful | {key.name for key in kind.keys} | {frame.key for frame in kind.frames}


def _check_keys_of_kind(row: YamlSection, kind: type[Term]) -> None:
    for key in _needed(kind):
        if key not in row:
            file = "the artefact's file" if key == "artefact" else "a file"
            raise row.refuse("no such key", f"{file}: {kind.kind} needs it", at=(key,))
    for key in OBSERVATION_KEYS.names:
        if key in row and key not in _useful(kind):
            in_file = key in SCALE_KEYS.names and (kind.needs_artefact or "board" in kind.files)
            file = "artefact" if kind.needs_artefact else "board"
            raise row.refuse(
                f"a key that {kind.kind} does not use",
                at=(key,),
                hint=f"write it into {file}.yaml" if in_file else "remove it, or check the kind",
            )


@dataclass(frozen=True)
class JobSpec(Displayable):
    """A whole ``calibration.yaml``, which is the file ``path``."""

    path: Path
    arm: ArmSpec = keyed(
        Field(
            "arm", Value("mapping", inside=fields_of(ArmSpec)), "The arm: its URDF, base and tip."
        )
    )
    parameters: tuple[Selection, ...] = keyed(
        Field(
            "parameters",
            rows(_selection, SELECTION_KEYS, 0),
            "What is estimated of the arm: later rows win; [] holds the arm as it is.",
        )
    )
    observations: tuple[ObservationSpec, ...] = keyed(
        rows(_observation, OBSERVATION_KEYS),
        "What was measured: any number of rows of any kinds, solved together.",
    )
    validation: tuple[ObservationSpec, ...] = keyed(
        replace(rows(_held_out, OBSERVATION_KEYS), inside=None),
        "Samples that are never fitted: they show the error on new data. The same keys as under "
        "observations. A row whose folder is empty is left out, with a warning.",
        (),
    )
    robots: Mapping[str, CellRobot] = keyed(ROBOTS, "", dict)
    solver: SolverSpec = keyed(mapping(SolverSpec), "Options of the solver.", SolverSpec())
    rule: Rule = keyed(mapping(Rule), "Thresholds for reports of wrong data.", Rule())
    encoders: EncoderSpec | None = keyed(
        mapping(EncoderSpec),
        "Noise of the encoders, for the error budget only.",
        None,
    )

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The chains that rows name, each with the one from whose tip it is seen, or nothing."""
        rows = (*self.observations, *self.validation)
        return tuple(dict.fromkeys((row.chain, row.base_chain) for row in rows))


JOB_KEYS: Final = fields_of(JobSpec)


def read_job(path: Path) -> JobSpec:
    """Read and check ``calibration.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, a key is unknown, missing, unusable or contradicts
            another, or a file it names does not exist; names the line and the key.
    """
    path = Path(path)
    top = YamlSection(read_yaml(path, JobError), JobError)
    JOB_KEYS.check(top)
    if "parameters" not in top:
        raise top.refuse(
            "no such key",
            "a list of rows with the parameters to estimate, or [] if the arm is right",
            at=("parameters",),
            hint='for example - {select: ["*.offset"], bound_deg: 15}',
        )
    arm = read_arm(top)
    spec = read_as(JobSpec, top, path=path, arm=arm, robots=arm.robots)
    # Later rows win: what the job says of the tip, and of couplings, counts.
    for row, section in _rows(spec, top):
        spec.arm.check_chain(section, row.chain, row.base_chain)
    spec = _with_clocks(spec, top)
    arm, rows_of_chains = arm.on_links((*spec.observations, *spec.validation))
    fitted = len(spec.observations)
    return replace(
        spec,
        arm=arm,
        parameters=(*arm.selections, *spec.parameters),
        observations=tuple(rows_of_chains[:fitted]),
        validation=tuple(rows_of_chains[fitted:]),
    )


def _with_clocks(spec: JobSpec, top: YamlSection) -> JobSpec:
    """What one row says of a clock holds for all rows with the same instrument or camera."""
    clocks = dict[tuple[str, ...], TimeOffset]()
    for row, section in _rows(spec, top):
        offset = row.time_offset
        if offset is not None and clocks.setdefault(_instrument(row), offset) != offset:
            raise section.refuse(
                f"another time offset than in an earlier row with the label {row.label!r}",
                "one clock per label",
                at=("time_offset_ms",),
                hint="write the same in both rows, or give the second one another label",
            )

    def clocked(rows: tuple[ObservationSpec, ...]) -> tuple[ObservationSpec, ...]:
        return tuple(
            replace(row, time_offset=clocks[_instrument(row)], time=False)
            if row.time_offset is None and _instrument(row) in clocks
            else row
            for row in rows
        )

    return replace(
        spec, observations=clocked(spec.observations), validation=clocked(spec.validation)
    )


def _instrument(row: ObservationSpec) -> tuple[str, ...]:
    # What stands beside the robot sees all of its chains.
    frames = KINDS[row.kind].frames
    stands = bool(frames) and frames[0].end == "base"
    carried = ("", "") if stands else (row.chain, row.link)
    return row.kind, row.label, row.base_chain, *carried


def _rows(spec: JobSpec, top: YamlSection) -> Iterator[tuple[ObservationSpec, YamlSection]]:
    """Every row, with where it stands."""
    for name, given in (("observations", spec.observations), ("validation", spec.validation)):
        if given:
            yield from zip(given, top.sections(name), strict=True)
