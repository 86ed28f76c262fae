"""``calibration.yaml`` as typed data: SI units, paths resolved, every key checked.

What a job means (which parameters a name selects, which samples fit the arm) is checked where
it is known. Here every key is known, every value usable and every file there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, cast

from suta_calib.errors import JobError, UrdfError
from suta_calib.job.couplings import Couplings
from suta_calib.job.keys import (
    ARM_KEYS,
    BOUND_AND_PRIOR_KEYS,
    COMMON_KEYS,
    ENCODER_KEYS,
    JOB_KEYS,
    OBSERVATION_KEYS,
    SEATING_KEYS,
    SELECTION_KEYS,
    SOLVER_KEYS,
)
from suta_calib.job.tip_offset import TipOffset
from suta_calib.measurements.exclusion import Exclusion, read_exclusion
from suta_calib.measurements.keys import SCALE_KEYS
from suta_calib.measurements.scale import GRADES, LengthScale, read_scale
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import Selection
from suta_calib.terms import KINDS, GivenPose, Term, every_grouping
from suta_calib.terms.given import POSE_KEYS

_ANGLE_KEYS: Final = ("huber_deg", "sigma_deg")
_LENGTH_KEYS: Final = ("huber_mm", "sigma_mm")
# What has not come to its minimum by then never will: 8 starts and 200 iterations are usual.
_MOST_STARTS: Final = 1000
_MOST_ITERATIONS: Final = 100_000

Hessian = Literal["gauss-newton", "exact"]


@dataclass(frozen=True)
class ArmSpec:
    """The arm: its URDF, and the ends of its chain.

    Attributes:
        urdf: the file.
        tip: link or frame whose pose matters.
        base: link the chain starts from; None for the root link.
        tip_offset: where the tip is in that frame, or None where it is its origin.
        section: where the job says so, for messages; None for no job.
        couplings: which of its joints the readings of others move too, or None.
        grade: how it was made, of `measurements.scale.GRADES`; empty where the job does not say.
    """

    urdf: Path
    tip: str
    base: str | None = None
    tip_offset: TipOffset | None = None
    section: YamlSection | None = field(default=None, repr=False, compare=False)
    couplings: Couplings | None = None
    grade: str = ""

    def model(self) -> ArmModel:
        """The arm at nominal.

        Raises:
            UrdfError: the file cannot be used, or has no place for the tip's offset.
            JobError: it has no such tip, base or joints; names the job's line.
        """
        try:
            arm = ArmModel.from_urdf(self.urdf, self.tip, self.base)
        except UrdfError as problem:
            if self.section is None or problem.where not in ("tip", "base"):
                raise
            expected = f"{problem.expected} {self.urdf}"
            at, hint = (problem.where,), problem.hint
            raise self.section.refuse(problem.found, expected, at=at, hint=hint) from None
        if self.couplings is not None:
            arm = self.couplings.on(arm)
        arm = arm.of_grade(self.grade)
        return arm if self.tip_offset is None else self.tip_offset.on(arm)

    def model_of(self, urdf: Path) -> ArmModel:
        """The same arm as another URDF has it, such as the calibrated one.

        Raises:
            UrdfError: the file cannot be used, or has no such tip or base.
            JobError: it has no joints that are coupled so.
        """
        # The tip's offset is in the URDF already; couplings are in none.
        return replace(self, urdf=urdf, tip_offset=None, section=None).model()


@dataclass(frozen=True)
class ObservationSpec:
    """One term: a kind of observation, and the files that hold it.

    Attributes:
        kind: of observation, one of `terms.KINDS`.
        samples: glob patterns as written in the job.
        sample_files: the files they match, at least one, each once, in the order of the patterns.
        artefact: the artefact's file, for the kinds that need one.
        label: tells several instruments or cameras of one kind apart.
        huber_m: threshold of the robust loss on lengths, m, or None for least squares.
        huber_rad: threshold of the robust loss on angles, rad, or None.
        sigma_m: standard deviation of a measured length or coordinate, m, or None.
        sigma_rad: standard deviation of a measured angle, rad, or None.
        sigma_fixed: whether the data have no say in them.
        line: line of the row in the job file.
        exclude: samples that are left out, or None.
        clearance_m, clearance_rad: what the artefact's sockets leave the tip, m and rad; zero where
            it fits.
        settings: what the kind's own keys say, as it has read them.
        given: what is known beforehand of where things stand, as `Term.given`.
        scale: how well the scale of the lengths is known that an instrument measures; None where
            the row says nothing of it.
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
    clearance_m: float = 0.0
    clearance_rad: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    given: Mapping[str, GivenPose] = field(default_factory=dict)
    scale: LengthScale | None = None

    @property
    def seated(self) -> bool:
        """Whether the row has the key ``seating``."""
        return self.clearance_m > 0 or self.clearance_rad > 0


@dataclass(frozen=True)
class SolverSpec:
    """How to solve.

    Attributes:
        starts: number of starts, the first from nominal.
        seed: of the random numbers the other starts are drawn with.
        hessian: Gauss-Newton approximation, or exact by automatic differentiation.
        max_iterations: per start.
    """

    starts: int = 1
    seed: int = 0
    hessian: Hessian = "gauss-newton"
    max_iterations: int = 200


@dataclass(frozen=True)
class EncoderSpec:
    """What is known of the encoders beforehand: only the error budget asks.

    Attributes:
        bits: revolute joints read whole steps of 2π / 2^bits; None where that is not known.
        noise_rad: standard deviation of a revolute joint's reading, rad, beside the steps.
        noise_m: the same of a prismatic joint's, m.
    """

    bits: int | None = None
    noise_rad: float = 0.0
    noise_m: float = 0.0


@dataclass(frozen=True)
class JobSpec:
    """A whole ``calibration.yaml``.

    Attributes:
        path: the job file.
        arm: the arm to calibrate.
        parameters: what is unknown; later rows win.
        observations: terms that are solved together, at least one.
        validation: terms that are never used for fitting.
        solver: how to solve.
        encoders: what is known of their noise, or None.
    """

    path: Path
    arm: ArmSpec
    parameters: tuple[Selection, ...]
    observations: tuple[ObservationSpec, ...]
    validation: tuple[ObservationSpec, ...] = ()
    solver: SolverSpec = SolverSpec()
    encoders: EncoderSpec | None = None


def read_job(path: Path) -> JobSpec:
    """Read and check ``calibration.yaml``; paths in it are relative to the file.

    Raises:
        JobError: the file cannot be read, a key is unknown, missing, unusable or contradicts
            another, or a file it names does not exist; names the line and the key.
    """
    path = Path(path)
    top = YamlSection(read_yaml(path, JobError), JobError)
    JOB_KEYS.check(top)
    arm = read_arm(top)
    if "parameters" not in top:
        raise top.refuse(
            "no such key",
            "a list of rows that say which parameters are unknown",
            at=("parameters",),
            hint='for example - {select: ["*.offset"], bound_deg: 15}',
        )
    # Later rows win: what the job says of the tip, and of couplings, counts.
    first = [
        *([] if arm.tip_offset is None else [arm.tip_offset.selection(arm.tip)]),
        *([] if arm.couplings is None else [arm.couplings.selection]),
    ]
    return JobSpec(
        path,
        arm,
        (*first, *(_selection(row) for row in top.sections("parameters"))),
        tuple(_observation(row) for row in top.sections("observations")),
        tuple(_observation(row) for row in top.sections("validation"))
        if "validation" in top
        else (),
        _solver(top.section("solver")) if "solver" in top else SolverSpec(),
        _encoders(top.section("encoders")) if "encoders" in top else None,
    )


def read_arm(top: YamlSection, urdf: Path | None = None) -> ArmSpec:
    """The key ``arm`` of a job, ``urdf`` in place of the file that it names."""
    arm = top.section("arm")
    ARM_KEYS.check(arm)
    base = arm.text("base") if "base" in arm else None
    offset, couplings = TipOffset.read(arm), Couplings.read(arm)
    grade = arm.choice("grade", GRADES) if "grade" in arm else ""
    if urdf is not None:
        # A calibrated one has the offset in it.
        return ArmSpec(urdf, arm.text("tip"), base, section=arm, couplings=couplings, grade=grade)
    file = arm.existing_file("urdf")
    return ArmSpec(file, arm.text("tip"), base, offset, arm, couplings, grade)


def _selection(row: YamlSection) -> Selection:
    SELECTION_KEYS.check(row)
    fixed = row.flag("fixed")
    sizes = BOUND_AND_PRIOR_KEYS.names
    priors = [key for key in sizes if key.startswith("prior") and key in row]
    for key in sizes:
        # A prior that is fixed is one whose size the data do not change.
        if fixed and not priors and key in row:
            raise row.refuse(f"{key} beside fixed: true", "one or the other", at=(key,))
    return Selection(
        row.texts("select"),
        bound_m=_length(row, "bound_mm"),
        bound_rad=_angle(row, "bound_deg"),
        prior_m=_length(row, "prior_mm"),
        prior_rad=_angle(row, "prior_deg"),
        fixed=fixed,
        line=row.line,
        bound_rad_per_nm=_angle(row, "bound_deg_per_nm"),
        prior_rad_per_nm=_angle(row, "prior_deg_per_nm"),
        bound_ratio=row.optional_number("bound", "positive"),
        prior_ratio=row.optional_number("prior", "positive"),
        bound_per_k=row.optional_number("bound_ppm_per_k", "positive", unit="1/K"),
        prior_per_k=row.optional_number("prior_ppm_per_k", "positive", unit="1/K"),
    )


def _observation(row: YamlSection) -> ObservationSpec:
    kind = _kind(row)
    clearance_m, clearance_rad = _seating(row, kind)
    fixed = row.flag("fixed")
    levels = ("sigma_px",) if kind.unit == "px" else ("sigma_mm", "sigma_deg")
    if fixed and not any(level in row for level in levels):
        raise row.refuse(
            "fixed: true without a noise level", f"{' or '.join(levels)} beside it", at=("fixed",)
        )
    return ObservationSpec(
        kind.kind,
        row.texts("samples"),
        row.files("samples"),
        row.existing_file("artefact") if "artefact" in row else None,
        row.text("label", default="default"),
        huber_m=_length(row, "huber_mm"),
        huber_rad=_angle(row, "huber_deg"),
        sigma_m=_length(row, "sigma_mm"),
        sigma_rad=_angle(row, "sigma_deg"),
        sigma_fixed=fixed,
        line=row.line,
        exclude=read_exclusion(row.section("exclude"), every_grouping())
        if "exclude" in row
        else None,
        clearance_m=clearance_m,
        clearance_rad=clearance_rad,
        settings=kind.read_settings(row),
        given=_given(row, kind),
        scale=read_scale(row),
    )


def _given(row: YamlSection, kind: type[Term]) -> dict[str, GivenPose]:
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


def _seating(row: YamlSection, kind: type[Term]) -> tuple[float, float]:
    if "seating" not in row:
        return 0.0, 0.0
    section = row.section("seating")
    SEATING_KEYS.check(section)
    if "rotation_deg" in section and not kind.has_angles:
        hint = "remove it: distances do not see how far the tip is turned"
        raise section.refuse(
            f"a key that {kind.kind} has no use for", at=("rotation_deg",), hint=hint
        )
    return _length(section, "clearance_mm") or 0.0, _angle(section, "rotation_deg") or 0.0


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
    return (*COMMON_KEYS.required, *artefact, *kind.required_keys())


def _useful(kind: type[Term]) -> set[str]:
    """Keys that a row of the kind may have: its own, and those common to all that it can use."""
    useful = {*COMMON_KEYS.names}
    useful -= set() if kind.needs_artefact else {"artefact", "seating"}
    useful -= set() if kind.has_angles else {*_ANGLE_KEYS}
    useful -= set() if kind.unit == "mm" else {*_LENGTH_KEYS}
    useful -= set() if kind.measures_lengths() else {*SCALE_KEYS.names}
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
                f"a key that {kind.kind} has no use for",
                at=(key,),
                hint=f"write it into {file}.yaml" if in_file else "remove it, or check the kind",
            )


def _solver(section: YamlSection) -> SolverSpec:
    SOLVER_KEYS.check(section)
    return SolverSpec(
        starts=section.integer("starts", SolverSpec.starts, 1, _MOST_STARTS),
        seed=section.integer("seed", SolverSpec.seed, minimum=0),
        hessian=cast(Hessian, section.choice("hessian", ("gauss-newton", "exact"), "gauss-newton")),
        max_iterations=section.integer(
            "max_iterations", SolverSpec.max_iterations, 1, _MOST_ITERATIONS
        ),
    )


def _encoders(section: YamlSection) -> EncoderSpec:
    ENCODER_KEYS.check(section)
    return EncoderSpec(
        section.bits("bits", minimum=1) if "bits" in section else None,
        section.optional_number("noise_deg", "non-negative", unit="rad") or 0.0,
        section.optional_number("noise_mm", "non-negative", unit="m") or 0.0,
    )


def _length(section: YamlSection, key: str) -> float | None:
    """A positive length in mm as m, or None."""
    return section.optional_number(key, "positive", unit="m")


def _angle(section: YamlSection, key: str) -> float | None:
    """A positive angle in degrees as rad, or None."""
    return section.optional_number(key, "positive", unit="rad")
