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

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from suta_calib.analysis.iso10360 import (
    AcceptanceMeasurements,
    AcceptanceTest,
    Articulation,
    DecisionRule,
    LengthErrors,
    Limits,
    StatedUncertainty,
    accept,
    articulations,
    probings,
    repeats,
)
from suta_calib.analysis.iso10360.limits_file import (
    JUDGED_KEYS,
    read_limits,
    read_rule,
    read_uncertainty,
)
from suta_calib.errors import InputError, JobError, SamplesError, UrdfError
from suta_calib.job.calibration import CalibrationJob, joint_ranges
from suta_calib.measurements import (
    SampleColumns,
    Samples,
    YamlSection,
    expand,
    read_artefact,
    read_csv_table,
    read_samples,
    read_yaml,
)
from suta_calib.model.arm import ArmModel
from suta_calib.terms import KINDS, ArmPoses, Setup, Term
from suta_calib.units import from_mm

_MEASURED: Final = ("lengths", "articulation", "probing", "repeatability")
_KEYS: Final = ("arm", "job", *_MEASURED, *JUDGED_KEYS)
# Keys that tell a calibration.yaml from an acceptance test.
_CALIBRATION: Final = ("observations", "parameters")
_NOMINAL: Final = (
    "This is the job's own URDF, as it was before calibration: give the calibrated one with --urdf."
)
_FITTED: Final = (
    "Some of these data are not held out: the arm may have been fitted to them, and errors "
    "elsewhere are larger."
)
# The kinds of observation that measure what is tested.
_LENGTHS, _ARTICULATIONS = (
    next(kind for kind in KINDS.values() if kind.tested == what)
    for what in ("length", "articulation")
)


@dataclass(frozen=True, eq=False)
class AcceptanceJob:
    """An acceptance test, everything it names read.

    Attributes:
        path: the file.
        urdf: the arm that was tested.
        measured: the errors found.
        limits, uncertainty, rule: what they are judged with.
    """

    path: Path
    urdf: Path
    measured: AcceptanceMeasurements
    limits: Limits
    uncertainty: StatedUncertainty
    rule: DecisionRule

    @classmethod
    def load(cls, path: str | Path, urdf: Path | None = None) -> AcceptanceJob:
        """Read an ``iso10360.yaml`` or a ``calibration.yaml`` and everything it names.

        Args:
            path: the file; paths in it are relative to it.
            urdf: another URDF of the same arm in place of the file's, such as a calibrated one.

        Raises:
            InputError: the first thing that cannot be used: file, line or key, what was found,
                what was expected.
        """
        path = Path(path)
        top = YamlSection(read_yaml(path, JobError), JobError)
        if any(key in top for key in _CALIBRATION):
            tested, measured = _of_calibration(path, urdf)
            return cls(path, tested, measured, Limits(), StatedUncertainty(), DecisionRule())
        top.check_keys(_KEYS)
        tested, measured = _tested(top, urdf)
        return cls(path, tested, measured, read_limits(top), read_uncertainty(top), read_rule(top))

    def run(self) -> AcceptanceTest:
        """Judge what was measured."""
        return accept(self.measured, self.limits, self.uncertainty, self.rule)


# ── what was measured ────────────────────────────────────────────────────────────────────────
def _tested(top: YamlSection, urdf: Path | None) -> tuple[Path, AcceptanceMeasurements]:
    if "job" in top:
        for key in ("arm", *_MEASURED):
            if key in top:
                raise top.refuse(f"{key} beside job", "one or the other", at=(key,))
        return _of_calibration(top.existing_file("job"), urdf)
    top.check_keys(_KEYS, required=("arm",))
    if not any(key in top for key in _MEASURED):
        raise top.refuse("nothing that was measured", f"one of {', '.join(_MEASURED)}")
    section = top.section("arm")
    section.check_keys(("urdf", "tip", "base"), required=("urdf", "tip"))
    base = section.text("base") if "base" in section else None
    file = section.existing_file("urdf") if urdf is None else urdf
    arm = ArmModel.from_urdf(file, section.text("tip"), base)
    return file, _measured(top, arm)


def _measured(top: YamlSection, arm: ArmModel) -> AcceptanceMeasurements:
    found = AcceptanceMeasurements()
    for key, read in zip(_MEASURED, (_lengths, _articulation, _probing, _repeats), strict=True):
        if key in top:
            section = top.section(key)
            try:
                found = read(found, section, arm)
            except InputError as problem:
                raise _placed(problem, section, "samples") from None
    return found


def _lengths(
    found: AcceptanceMeasurements, section: YamlSection, arm: ArmModel
) -> AcceptanceMeasurements:
    section.check_keys(("artefact", "samples", "bidirectional"), required=("artefact", "samples"))
    samples = _samples(section, arm, _LENGTHS.columns.labels)
    artefact = read_artefact(section.existing_file("artefact"))
    errors = LengthErrors.of(_LENGTHS.over(ArmPoses(arm, samples), Setup(artefact)))
    return replace(found, lengths=errors, bidirectional=section.flag("bidirectional"))


def _articulation(
    found: AcceptanceMeasurements, section: YamlSection, arm: ArmModel
) -> AcceptanceMeasurements:
    section.check_keys(("samples", "probed"), required=("samples",))
    sphere = section.choice("probed", ("seat", "sphere"), "seat") == "sphere"
    samples = _samples(section, arm, ("point",), ("articulation",))
    point, each = samples.labels["point"], samples.labels.get("articulation")
    if sphere and each is None:
        raise section.refuse(
            "spheres, but samples without a column articulation",
            "a column articulation that says which touches make a sphere",
            at=("probed",),
        )
    places = articulations(arm.forward(samples.q)[1], point, each, sphere=sphere)
    return replace(found, articulations=places)


def _probing(
    found: AcceptanceMeasurements, section: YamlSection, arm: ArmModel
) -> AcceptanceMeasurements:
    keys = ("samples", "diameter_mm", "sigma_mm", "stylus_diameter_mm")
    section.check_keys(keys, required=("samples", "diameter_mm"))
    diameter = from_mm(section.number("diameter_mm", "positive"))
    stylus = section.optional_number("stylus_diameter_mm", "non-negative", from_mm(1.0)) or 0.0
    sigma = section.optional_number("sigma_mm", "non-negative", from_mm(1.0)) or 0.0
    samples = _samples(section, arm, ("sphere",))
    places = arm.forward(samples.q)[1], samples.labels["sphere"]
    return replace(found, spheres=probings(*places, diameter + stylus), sphere_std=sigma)


def _repeats(
    found: AcceptanceMeasurements, section: YamlSection, arm: ArmModel
) -> AcceptanceMeasurements:
    section.check_keys(("samples",), required=("samples",))
    samples = _samples(section, arm, ("point",))
    return replace(found, repeats=repeats(arm.forward(samples.q)[1], samples.labels["point"]))


def _samples(
    section: YamlSection, arm: ArmModel, labels: tuple[str, ...], optional: tuple[str, ...] = ()
) -> Samples:
    files: dict[Path, None] = {}
    for pattern in section.texts("samples"):
        try:
            files |= dict.fromkeys(expand(pattern, section.document.path.parent))
        except SamplesError as problem:
            raise section.refuse(problem.found, problem.expected, at=("samples",)) from None
    present = [read_csv_table(file).columns for file in files]
    labels += tuple(name for name in optional if all(name in columns for columns in present))
    return read_samples(list(files), joint_ranges(arm), SampleColumns(labels=labels))


def _placed(problem: InputError, section: YamlSection, key: str) -> InputError:
    """The same error with a place in the job, for what was found without knowing of files."""
    if problem.file is not None:
        return problem
    found = f"{problem.where}: {problem.found}" if problem.where else problem.found
    return section.refuse(found, problem.expected, at=(key,), hint=problem.hint)


# ── from a calibration ───────────────────────────────────────────────────────────────────────
def _of_calibration(path: Path, urdf: Path | None) -> tuple[Path, AcceptanceMeasurements]:
    """Lengths and articulations of a calibration: from its held-out data where it has them."""
    job = CalibrationJob.load(path)
    tested = job.spec.arm.urdf if urdf is None else urdf
    arm = job.arm
    if urdf is not None:
        arm = ArmModel.from_urdf(urdf, job.spec.arm.tip, job.spec.arm.base)
        if arm.joints != job.arm.joints:
            raise UrdfError(
                f"the moving joints {', '.join(arm.joints)}",
                f"those of the job's arm: {', '.join(job.arm.joints)}",
                file=urdf,
            )
    lengths = _first(job, _LENGTHS)
    points = _first(job, _ARTICULATIONS)
    if not lengths and not points:
        raise JobError(
            f"neither {_LENGTHS.kind} nor {_ARTICULATIONS.kind}",
            "one of them among validation or observations: lengths and articulations",
            file=path,
        )
    notes = [_NOMINAL] if urdf is None else []
    if any(term in job.observations for term in (*lengths, *points)):
        notes.append(_FITTED)
    places = _points(points, arm)
    return tested, AcceptanceMeasurements(
        _length_errors(lengths, arm), articulations=places, notes=tuple(notes)
    )


def _first(job: CalibrationJob, kind: type[Term]) -> list[Term]:
    """The held-out terms of a kind, or the fitted ones where none is held out."""
    for terms in (job.validation, job.observations):
        if some := [term for term in terms if isinstance(term, kind)]:
            return some
    return []


def _length_errors(terms: list[Term], arm: ArmModel) -> LengthErrors | None:
    errors = [LengthErrors.of(term.over_poses(ArmPoses(arm, term.poses.samples))) for term in terms]
    return LengthErrors.joined(errors) if errors else None


def _points(terms: list[Term], arm: ArmModel) -> tuple[Articulation, ...]:
    found: list[Articulation] = []
    for term in terms:
        samples = term.poses.samples
        found += articulations(arm.forward(samples.q)[1], samples.labels["point"])
    return tuple(found)
