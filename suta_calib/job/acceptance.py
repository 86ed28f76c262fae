"""``iso10360.yaml``: an acceptance test as a file, read, checked and measured.

::

    arm: {urdf: results/calibrated.urdf, tip: tip}
    lengths: {artefact: artefact.yaml, samples: lengths.csv}       # placement, repeat, landmark
    articulation: {samples: articulation.csv}                      # point[, articulation]
    probing: {samples: probing.csv, diameter_mm: 25, stylus_diameter_mm: 6}  # sphere
    repeatability: {samples: seat.csv}                             # point
    mpe: {length: {a_um: 60, k: 10, max_um: 150}, location_mm: 0.15}
    uncertainty: {length_mm: 0.004}                                # expanded, k = 2
    decision_rule: guarded

In place of ``arm`` and of what was measured ``job: calibration.yaml`` takes both from a
calibration's held-out data; and such a job may be given itself, without limits.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from suta_calib.arm_keys import ArmSpec, read_arm
from suta_calib.arrays import IntArray
from suta_calib.display import Displayable
from suta_calib.errors import InputError, JobError, UrdfError
from suta_calib.inputs import UrdfFile
from suta_calib.job.calibration import CalibrationJob
from suta_calib.job.job_terms import read_term
from suta_calib.job.limits import JUDGED_KEYS, DecisionRule, Limits, StatedUncertainty, read_judged
from suta_calib.job.schema import ObservationSpec
from suta_calib.measurements import SampleColumns, Samples, YamlSection, read_samples, read_yaml
from suta_calib.measurements.fields import (
    FILE,
    FILES,
    FLAG,
    LENGTH,
    LENGTH_OR_0,
    Field,
    Fields,
    Value,
    choice,
    fields_of,
)
from suta_calib.model.arm import ArmModel
from suta_calib.terms import KINDS, ArmPoses, Term
from suta_calib.terms.poses import joint_ranges, resolutions, together

_SAMPLES: Final = Field("samples", FILES, "The samples (CSV files, globs).", required=True)
LENGTHS_KEYS: Final = Fields(
    Field("artefact", FILE, "The calibrated artefact.yaml.", required=True),
    _SAMPLES,
    Field("bidirectional", FLAG, "true if lengths were probed from both sides."),
)
ARTICULATION_KEYS: Final = Fields(
    _SAMPLES,
    Field(
        "probed",
        choice(("seat", "sphere")),
        "seat (the default); or sphere: the centre of the touches counts.",
    ),
)
PROBING_KEYS: Final = Fields(
    _SAMPLES,
    Field("diameter_mm", LENGTH, "Calibrated diameter of the sphere.", required=True),
    Field(
        "sigma_mm", LENGTH_OR_0, "Its standard uncertainty; 0 without it.", given_attribute="std"
    ),
    Field(
        "stylus_diameter_mm",
        LENGTH_OR_0,
        "Diameter of the stylus' ball; 0 without it.",
        given_attribute="stylus",
    ),
)
VISITS_KEYS: Final = Fields(_SAMPLES)
_TESTS: Final = (
    Field(
        "lengths",
        Value("mapping", inside=LENGTHS_KEYS),
        "Lengths of a calibrated artefact: columns placement, repeat, landmark.",
    ),
    Field(
        "articulation",
        Value("mapping", inside=ARTICULATION_KEYS),
        "Points touched from several articulations: column point, and articulation where each has "
        "several touches.",
    ),
    Field(
        "probing",
        Value("mapping", inside=PROBING_KEYS),
        "Touches of calibrated spheres: column sphere.",
    ),
    Field("repeatability", Value("mapping", inside=VISITS_KEYS), "Repeated visits: column point."),
)
ACCEPTANCE_KEYS: Final = Fields(
    Field(
        "arm",
        Value("mapping", inside=fields_of(ArmSpec)),
        "The arm that is tested, such as a calibrated one.",
    ),
    Field(
        "job",
        Value("file"),
        "A calibration.yaml: the arm and its validation data are tested, in place of the keys arm "
        "and those of the tests.",
    ),
    *_TESTS,
    *JUDGED_KEYS,
)
_AnyTerm = TypeVar("_AnyTerm", bound=Term)
_MEASURED: Final = tuple(key.name for key in _TESTS)
# Keys that tell a calibration.yaml from an acceptance test.
_CALIBRATION: Final = ("observations", "parameters")
_NOMINAL: Final = (
    "This is the job's URDF from before the calibration. Give the calibrated one with --urdf."
)
_FITTED: Final = (
    "Some of these data are not validation data: the arm may have been fitted to them, and errors "
    "elsewhere are larger."
)


@dataclass(frozen=True, eq=False)
class ProbedSpheres(Displayable):
    """Touches of calibrated spheres.

    Attributes:
        samples: with a label ``sphere``.
        diameter: that the tip's centre is to find: the sphere's and the stylus', m.
        std: standard uncertainty of the sphere's diameter, m.
    """

    samples: Samples
    diameter: float
    std: float


# The kinds of observation that measure what is tested.
_LENGTHS, _ARTICULATIONS = (
    next(kind for kind in KINDS.values() if kind.tested == what)
    for what in ("length", "articulation")
)


@dataclass(frozen=True, eq=False)
class AcceptanceJob(Displayable):
    """An acceptance test, everything it names read; empty or None where a test was not made.

    Attributes:
        path: the file.
        arm: the arm that is tested, as its URDF has it.
        lengths: a calibrated artefact's, over the arm's poses.
        bidirectional: whether lengths were probed from both sides.
        articulation: touches of points, with a label ``point`` and, for several touches in each
            articulation, ``articulation``.
        on_spheres: whether the touches of an articulation lie on a sphere whose centre counts.
        probing: of spheres.
        repeatability: repeated visits, with a label ``point``.
        limits, uncertainty, rule: what errors are judged with.
        notes: what must be known of these data, one sentence each.
        sections: what the file says of each of them, for messages.
    """

    path: Path
    arm: ArmModel
    lengths: tuple[Term, ...] = ()
    bidirectional: bool = False
    articulation: tuple[Samples, ...] = ()
    on_spheres: bool = False
    probing: ProbedSpheres | None = None
    repeatability: Samples | None = None
    limits: Limits = field(default_factory=Limits)
    uncertainty: StatedUncertainty = field(default_factory=StatedUncertainty)
    rule: DecisionRule = field(default_factory=DecisionRule)
    notes: tuple[str, ...] = ()
    sections: Mapping[str, YamlSection] = field(default_factory=dict)

    @classmethod
    def load(cls, path: str | Path, urdf: UrdfFile | None = None, chain: str = "") -> AcceptanceJob:
        """Read an ``iso10360.yaml`` or a ``calibration.yaml`` and everything it names.

        Args:
            path: the file; paths in it are relative to it.
            urdf: another URDF of the same arm in place of the file's, such as a calibrated one.
            chain: which is tested, of a robot with several.

        Raises:
            InputError: the first thing that cannot be used: file, line or key, what was found,
                what was expected.
        """
        path = Path(path)
        top = YamlSection(read_yaml(path, JobError), JobError)
        if any(key in top for key in _CALIBRATION):
            return _of_calibration(path, urdf, chain)
        ACCEPTANCE_KEYS.check(top)
        return replace(_tested(top, urdf, chain), path=path, **read_judged(top))

    @contextmanager
    def error_context(self, key: str) -> Iterator[None]:
        """Errors of a computation, told as errors of the samples under one key of the file.

        Args:
            key: ``lengths``, ``articulation``, ``probing`` or ``repeatability``.

        Raises:
            InputError: was raised within; says the same and, where it named no file, this place.
        """
        try:
            yield
        except InputError as problem:
            if problem.file is not None or key not in self.sections:
                raise
            description = f"{problem.where}: {problem.found}" if problem.where else problem.found
            # Rows that were left out are missing for a reason.
            why = [note.rstrip(".") for note in self.notes if note.startswith(f"{key}:")]
            raise self.sections[key].refuse(
                description,
                problem.expected,
                at=("samples",),
                hint="; ".join([problem.hint, *why]).strip("; "),
            ) from None


# ── what was measured ────────────────────────────────────────────────────────────────────────
def _tested(top: YamlSection, urdf: UrdfFile | None, chain: str) -> AcceptanceJob:
    if "job" in top:
        for key in ("arm", *_MEASURED):
            if key in top:
                raise top.refuse(f"{key} beside job", "one or the other", at=(key,))
        return _of_calibration(top.existing_file("job"), urdf, chain)
    if not any(key in top for key in _MEASURED):
        raise top.refuse("no measurements", f"one of {', '.join(_MEASURED)}")
    spec = read_arm(top, urdf)
    arm = spec.model(chain)
    sections = {key: top.section(key) for key in _MEASURED if key in top}
    job = AcceptanceJob(top.document.path, arm, sections=sections)
    for key, read in zip(_MEASURED, (_lengths, _articulation, _probing, _visits), strict=True):
        if key in sections:
            job = replace(job, **read(arm, sections[key]))
    return _without_copies(job)


def _without_copies(job: AcceptanceJob) -> AcceptanceJob:
    """Without touches that another stands for: what was not measured would keep every limit."""
    probing, visits, notes = job.probing, job.repeatability, list[str]()
    measured = [*(term.poses.samples for term in job.lengths), *job.articulation]
    measured += [] if probing is None else [probing.samples]
    measured += [] if visits is None else [visits]
    q = np.vstack([samples.q for samples in measured])
    moving = q[:, np.ptp(q, axis=0) > 0.0]
    if moving.size and np.all(resolutions(moving) > 0.0):
        # An arm with so coarse encoders may read the same when it comes back.
        return job

    def once(key: str, samples: Samples) -> IntArray:
        # Readings that differ by less, rad or m, no encoder has told apart.
        rows = np.unique(together(samples.q, 1e-7), return_index=True)[1]
        if copies := len(samples) - len(rows):
            notes.append(
                f"{key}: {copies} of {len(samples)} touches repeat another touch, except for "
                "digits finer than any encoder's. They are copies, and left out."
            )
        return np.sort(rows)

    articulation = [touches.take(once("articulation", touches)) for touches in job.articulation]
    if probing is not None:
        touched = probing.samples.take(once("probing", probing.samples))
        probing = replace(probing, samples=touched)
    if visits is not None:
        visits = visits.take(once("repeatability", visits))
    with job.error_context("lengths"):
        lengths = [term.take(once("lengths", term.poses.samples)) for term in job.lengths]
    return replace(
        job,
        lengths=tuple(lengths),
        articulation=tuple(articulation),
        probing=probing,
        repeatability=visits,
        notes=(*job.notes, *notes),
    )


def _lengths(arm: ArmModel, section: YamlSection) -> dict[str, Any]:
    values = LENGTHS_KEYS.read(section)
    patterns = section.texts("samples")
    row = ObservationSpec(
        _LENGTHS.kind, patterns, values["samples"], values["artefact"], line=section.line
    )
    term = read_term(arm, row, section.document.path)
    return {"lengths": (term,), "bidirectional": values.get("bidirectional", False)}


def _articulation(arm: ArmModel, section: YamlSection) -> dict[str, Any]:
    values = ARTICULATION_KEYS.read(section)
    sphere = values.get("probed") == "sphere"
    samples = _samples(arm, values, "point", "articulation")
    if sphere and "articulation" not in samples.labels:
        raise section.refuse(
            "spheres, but samples without a column articulation",
            "a column articulation that says which touches make a sphere",
            at=("probed",),
        )
    return {"articulation": (samples,), "on_spheres": sphere}


def _probing(arm: ArmModel, section: YamlSection) -> dict[str, Any]:
    values = PROBING_KEYS.read(section)
    diameter = values["diameter"] + values.get("stylus", 0.0)
    samples = _samples(arm, values, "sphere")
    return {"probing": ProbedSpheres(samples, diameter, values.get("std", 0.0))}


def _visits(arm: ArmModel, section: YamlSection) -> dict[str, Any]:
    return {"repeatability": _samples(arm, VISITS_KEYS.read(section), "point")}


def _samples(arm: ArmModel, values: Mapping[str, Any], label: str, *optional: str) -> Samples:
    columns = SampleColumns(labels=(label,), optional_labels=optional)
    return read_samples(values["samples"], joint_ranges(arm), columns)


# ── from a calibration ───────────────────────────────────────────────────────────────────────
def _of_calibration(path: Path, urdf: UrdfFile | None, chain: str) -> AcceptanceJob:
    """Lengths and articulations of a calibration: from its held-out data where it has them."""
    job = CalibrationJob.load(path)
    nominal = arm = job.arm.chosen(chain)
    if nominal.tilt_sensors:
        raise JobError(
            "a calibration with tilt sensors",
            "one of an arm whose tip follows from its joints alone: that is what is accepted",
            file=path,
            where="arm.tilt_sensors",
        )
    if urdf is not None:
        arm = job.spec.arm.mechanism_of(urdf, job.arm, job.spec.pairs).chosen(chain)
        if arm.joints != nominal.joints:
            raise UrdfError(
                f"the moving joints {', '.join(arm.joints)}",
                f"those of the job's arm: {', '.join(nominal.joints)}",
                file=Path(urdf),
            )
    lengths = _first(job, nominal, _LENGTHS)
    points = _first(job, nominal, _ARTICULATIONS)
    if not lengths and not points:
        raise JobError(
            f"neither {_LENGTHS.kind} nor {_ARTICULATIONS.kind}",
            "one of them among validation or observations: lengths and articulations",
            file=path,
        )
    fitted = any(term in job.observations for term in (*lengths, *points))
    return AcceptanceJob(
        path,
        arm,
        tuple(term.over_poses(ArmPoses(arm, term.poses.samples)) for term in lengths),
        articulation=tuple(term.poses.samples for term in points),
        notes=(*([_NOMINAL] if urdf is None else ()), *([_FITTED] if fitted else ())),
    )


def _first(job: CalibrationJob, arm: ArmModel, kind: type[_AnyTerm]) -> list[_AnyTerm]:
    """The held-out terms of a kind, or the fitted ones where none is held out."""
    for terms in (job.validation, job.observations):
        of_arm = (t for t in terms if isinstance(t.poses, ArmPoses) and t.poses.arm is arm)
        if of_kind := [term for term in of_arm if isinstance(term, kind)]:
            return of_kind
    return []
