"""``calibration.yaml`` as typed data: SI units, paths resolved, every key checked.

What a job means (which parameters a name selects, which samples fit the arm) is checked where
it is known. Here every key is known, every value usable and every file there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, TypeVar, get_args

from suta_calib.display import Displayable
from suta_calib.errors import JobError, UrdfError, did_you_mean
from suta_calib.inputs import UrdfFile
from suta_calib.job.arm_keys import LOOP_KEYS, TIP_OFFSET_KEYS, Couplings, TipOffset, read_loop
from suta_calib.job.keys import BOUND_AND_PRIOR_KEYS, COMMON_KEYS, OBSERVATION_KEYS, SELECTION_KEYS
from suta_calib.measurements.exclusion import Exclusion
from suta_calib.measurements.fields import (
    ANGLE_OR_0,
    BASE,
    LENGTH_OR_0,
    TIP,
    URDF,
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
from suta_calib.measurements.scale import GRADES, SCALE_KEYS, LengthScale
from suta_calib.measurements.yaml_file import YamlSection, read_yaml
from suta_calib.model.arm import ArmModel
from suta_calib.model.loop import Loop
from suta_calib.model.parameters import Selection
from suta_calib.model.robot import Robot
from suta_calib.terms import KINDS, GivenPose, Seating, Term
from suta_calib.terms.given_pose import POSE_KEYS
from suta_calib.trust.rule import Rule

_ANGLE_KEYS: Final = ("huber_deg", "sigma_deg")
_LENGTH_KEYS: Final = ("huber_mm", "sigma_mm")

Hessian = Literal["gauss-newton", "exact"]
_AnyMechanism = TypeVar("_AnyMechanism", ArmModel, Robot)


_TIP_OFFSET: Final = Field(
    "tip_offset_mm",
    Value("x, y, z in mm, or a mapping", TipOffset.read, TIP_OFFSET_KEYS),
    "Position of the tip in that frame, for a probe that the URDF does not have. Three numbers are "
    "fixed; with bound_mm or prior_mm the position is estimated.",
)


@dataclass(frozen=True)
class ChainSpec(Displayable):
    """One of several chains of a robot: an entry of ``arm: {chains: …}``."""

    tip: str = keyed(TIP)
    base: str | None = keyed(BASE, "", None)
    tip_offset: TipOffset | None = keyed(_TIP_OFFSET, "", None)


def _chains(arm: YamlSection, key: str) -> dict[str, ChainSpec]:
    """Chains by name, no two of them with the same ends."""
    below = arm.section(key)
    chains = {str(name): read_as(ChainSpec, below.section(name)) for name in below.data}
    names = dict[tuple[str, str | None], str]()
    for name, chain in chains.items():
        other = names.setdefault((chain.tip, chain.base), name)
        if other != name:
            problem = f"the tip '{chain.tip}', which is the tip of the chain {other} too"
            hint = "name one chain in both rows of the observations"
            raise below.refuse(problem, "another tip or base", at=(name,), hint=hint)
    return chains


@dataclass(frozen=True)
class ArmSpec(Displayable):
    """The key ``arm`` of a job; ``section`` is where it stands, None for no job."""

    urdf: UrdfFile = keyed(URDF)
    tip: str = keyed(replace(TIP, required=False), "", "")
    base: str | None = keyed(BASE, "", None)
    chains: Mapping[str, ChainSpec] = keyed(
        Value("chains by name", _chains, fields_of(ChainSpec)),
        "Several chains that share joints, in place of tip: {left: {tip: left_hand}, right: {tip: "
        "right_hand}}. Every row of observations and validation then names its chain.",
        dict,
    )
    tip_offset: TipOffset | None = keyed(_TIP_OFFSET, "", None)
    section: YamlSection | None = field(default=None, repr=False, compare=False)
    couplings: Couplings | None = keyed(
        Value("by joint, numbers by joint", Couplings.read),
        "Joints that the readings of other joints move too, as through a parallelogram: "
        "{joint_3: {joint_2: -1}} turns joint_3 by -1 times the reading of joint_2 as well. The "
        "number is fixed, unless a row estimates joint_3.coupling[joint_2].",
        None,
    )
    loops: tuple[Loop, ...] = keyed(
        rows(read_loop, LOOP_KEYS),
        "Closed loops that hang on the tree of the URDF, as the four-bar of a palletizing arm: "
        "two frames that a pin joins, and the two joints without an encoder.",
        (),
    )
    grade: str = keyed(
        choice(GRADES, "certified, machined or printed"),
        "How the arm was made. It sets the tolerance of the dimensions that are not estimated, and "
        "of a common scale of all lengths. Every ± that depends on them includes this tolerance. "
        "If it is not given, the errors of the estimated dimensions set the tolerance, but never "
        "less than that of machined parts.",
        "",
    )

    @property
    def tips(self) -> dict[str, TipOffset | None]:
        """What is said of the place of every tip, by the tip's name."""
        if self.chains:
            return {chain.tip: chain.tip_offset for chain in self.chains.values()}
        return {self.tip: self.tip_offset}

    def ends(self, pairs: Iterable[tuple[str, str]] = ()) -> dict[str, tuple[str, str | None]]:
        """Tip and base of every chain by name, and of chains that are seen from another's tip."""
        chains = {n: (c.tip, c.base or self.base) for n, c in self.chains.items()}
        for seen, seeing in pairs:
            if seeing:
                chains[seen_from(seen, seeing)] = (chains[seen][0], chains[seeing][0])
        return chains

    def mechanism(self, pairs: Iterable[tuple[str, str]] = ()) -> ArmModel | Robot:
        """The arm, or the robot with its chains, at nominal.

        Args:
            pairs: chains that rows name, each with the one from whose tip it is seen, or nothing.

        Raises:
            UrdfError: the file cannot be used, or has no place for the tip's offset.
            JobError: it has no such tip, base or joints; names the job's line.
        """
        return self.model() if not self.chains else self._completed(partial(self._robot, pairs))

    def _robot(self, pairs: Iterable[tuple[str, str]]) -> Robot:
        return Robot.from_urdf(self.urdf, self.ends(pairs), self.loops)

    def model(self, chain: str = "") -> ArmModel:
        """The arm at nominal; of several chains the one of this name.

        Raises:
            UrdfError: the file cannot be used, or has no place for the tip's offset.
            JobError: it has no such tip, base, joints or chain; names the job's line.
        """
        if not self.chains:
            read = partial(ArmModel.from_urdf, self.urdf, self.tip, self.base, self.loops)
            return self._completed(read)
        if chain not in self.chains:
            names, found = ", ".join(self.chains), f"chain '{chain}'" if chain else "several chains"
            raise JobError(found, f"the name of one of the chains {names}", where="arm.chains")
        return self._completed(partial(self._robot, ())).chains[chain]

    def _completed(self, read: Callable[[], _AnyMechanism]) -> _AnyMechanism:
        """What was read from the URDF, with what else the job says of it."""
        try:
            arm = read()
        except UrdfError as problem:
            if self.section is None or problem.where not in ("tip", "base"):
                raise
            expected = f"{problem.expected} {self.urdf}"
            at, hint = (problem.where,) if problem.where in self.section else (), problem.hint
            raise self.section.refuse(problem.found, expected, at=at, hint=hint) from None
        if self.couplings is not None:
            arm = self.couplings.on(arm)
        arm = arm.of_grade(self.grade)
        for tip, offset in self.tips.items():
            arm = arm if offset is None else offset.on(arm, tip)
        return arm

    def model_of(self, urdf: UrdfFile) -> ArmModel:
        """The same arm as another URDF has it, such as the calibrated one.

        Raises:
            UrdfError: the file cannot be used, or has no such tip or base.
            JobError: it has no joints that are coupled so.
        """
        # The tip's offset is in the URDF already; couplings are in none.
        return self._of(urdf).model()

    def mechanism_of(
        self, urdf: UrdfFile, pairs: Iterable[tuple[str, str]] = ()
    ) -> ArmModel | Robot:
        """`mechanism` of another URDF, likewise."""
        return self._of(urdf).mechanism(pairs)

    def _of(self, urdf: UrdfFile) -> ArmSpec:
        chains = {n: replace(chain, tip_offset=None) for n, chain in self.chains.items()}
        return replace(self, urdf=urdf, tip_offset=None, chains=chains, section=None)


def seen_from(seen: str, seeing: str) -> str:
    """The name of the chain that ends at one tip and begins at another; nothing for the base."""
    return f"{seen} seen from {seeing}" if seeing else seen


@dataclass(frozen=True)
class ObservationSpec(Displayable):
    """One term: a row of a job's ``observations`` or ``validation`` (`keys.COMMON_KEYS`), in SI.

    Attributes:
        samples: glob patterns as written in the job.
        sample_files: the files they match, at least one, each once, in the order of the patterns.
        sigma_fixed: whether the data have no say in the standard deviations.
        line: line of the row in the job file.
        settings: what the kind's own keys say, as it has read them.
        given: what is known beforehand of where things stand, as `Term.given`.
        scale: how well the scale of the lengths is known that an instrument measures; None where
            the row says nothing of it.
        chain: whose samples they are, where the arm has several chains.
        base_chain: the chain from whose tip it is seen; empty for its own base.
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


def _observation(row: YamlSection) -> ObservationSpec:
    kind = _kind(row)
    files = row.texts("samples"), row.files("samples")
    values = COMMON_KEYS.values(row)
    own = f"sigma_{kind.unit}".rstrip("_")
    levels = ("sigma_mm", "sigma_deg") if kind.unit == "mm" else (own,)
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
    settings, given = kind.read_settings(row), _given(row, kind)
    return ObservationSpec(
        kind.kind, *files, line=row.line, settings=settings, given=given, **values
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
        Value("mapping", inside=fields_of(ArmSpec)), "The arm: its URDF, base and tip."
    )
    parameters: tuple[Selection, ...] = keyed(
        Field(
            "parameters",
            rows(_selection, SELECTION_KEYS),
            "What is estimated: one row at least, later rows win.",
        )
    )
    observations: tuple[ObservationSpec, ...] = keyed(
        rows(_observation, OBSERVATION_KEYS),
        "What was measured: any number of rows of any kinds, solved together.",
    )
    validation: tuple[ObservationSpec, ...] = keyed(
        replace(rows(_observation, OBSERVATION_KEYS), inside=None),
        "Samples that are never fitted: they show the error on new data. The same keys as under "
        "observations.",
        (),
    )
    solver: SolverSpec = keyed(mapping(SolverSpec), "Options of the solver.", SolverSpec())
    rule: Rule = keyed(mapping(Rule), "Thresholds for reports of wrong data.", Rule())
    encoders: EncoderSpec | None = keyed(
        mapping(EncoderSpec),
        "Noise of the encoders, for the error budget only.",
        None,
    )


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
            "a list of rows with the parameters to estimate",
            at=("parameters",),
            hint='for example - {select: ["*.offset"], bound_deg: 15}',
        )
    spec = read_as(JobSpec, top, path=path, arm=read_arm(top))
    # Later rows win: what the job says of the tip, and of couplings, counts.
    for row, section in _rows(spec, top):
        _check_chain(spec.arm, row, section)
    first = [
        *(offset.selection(tip) for tip, offset in spec.arm.tips.items() if offset is not None),
        *([] if spec.arm.couplings is None else [spec.arm.couplings.selection]),
    ]
    return replace(spec, parameters=(*first, *spec.parameters))


def read_arm(top: YamlSection, urdf: UrdfFile | None = None) -> ArmSpec:
    """The key ``arm`` of a job, ``urdf`` in place of the file that it names."""
    section = top.section("arm")
    # A calibrated one has the offset in it.
    other: dict[str, Any] = {} if urdf is None else {"urdf": urdf, "tip_offset": None}
    arm = read_as(ArmSpec, section, section=section, **other)
    if not arm.tip and not arm.chains:
        raise section.refuse("no such key", "tip: the link or frame of the tip", at=("tip",))
    for key in ("tip", "tip_offset_mm"):
        if arm.chains and key in section:
            hint = "write it into the entry of its chain"
            raise section.refuse(f"{key} beside chains", "one or the other", at=(key,), hint=hint)
    return arm


def _rows(spec: JobSpec, top: YamlSection) -> Iterator[tuple[ObservationSpec, YamlSection]]:
    """Every row, with where it stands."""
    for name, given in (("observations", spec.observations), ("validation", spec.validation)):
        if given:
            yield from zip(given, top.sections(name), strict=True)


def _check_chain(arm: ArmSpec, row: ObservationSpec, section: YamlSection) -> None:
    """Refuse a row of a chain that the arm does not have, and one that does not say its chain."""
    names = tuple(arm.chains)
    for key, name in (("chain", row.chain), ("base_chain", row.base_chain)):
        if name and name not in names:
            expected = f"one of {', '.join(names)}" if names else "no such key: the arm has one tip"
            hint = did_you_mean(name, names)
            raise section.refuse(f"'{name}'", expected, at=(key,), hint=hint)
    if names and not row.chain:
        expected = f"the chain that its samples are of: {', '.join(names)}"
        raise section.refuse("no such key", expected, at=("chain",))
    if row.chain and row.chain == row.base_chain:
        raise section.refuse(f"'{row.chain}' as both", "two chains", at=("base_chain",))
