"""A certificate: an answer, what the laboratory adds, and where all of it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from suta_calib.assessment import Assessment, judged, read_assessment, refuse_unusable
from suta_calib.certificate.answer import answer_of
from suta_calib.certificate.content import Content, Decision
from suta_calib.certificate.details import TO_BE_GIVEN, Details
from suta_calib.display import Displayable
from suta_calib.errors import InputError, did_you_mean
from suta_calib.exchange.cells import is_folder
from suta_calib.exchange.result import content_digest
from suta_calib.inputs import read_input
from suta_calib.tracking.uncertainty import read_json_object
from suta_calib.units import stored
from suta_calib.words import listed

# Names of the JSON that commands write, in a folder that is given in its place.
RECORDS: Final = (
    *("result.json", "iso10360.json", "repeatability.json", "certify.json", "detect.json"),
)


def own_version() -> str:
    """Of this package, which is above every part of it."""
    return str(import_module("suta_calib").__version__)


@dataclass(frozen=True, eq=False)
class Certificate(Displayable):
    """What is printed.

    Attributes:
        content: what the answer says.
        details: what the laboratory adds.
        decisions: on the limits that it asked for, and those that the answer took.
        result: the answer's file.
        digest: SHA-256 of it.
        verdict: of the answer, in words.
        run: id of the run that wrote it; empty where it says none.
        inputs: SHA-256 of its inputs, by name.
        outputs: SHA-256 of the files that were written with it, by name.
        versions: of the packages that computed it.
    """

    content: Content
    details: Details
    decisions: tuple[Decision, ...]
    result: Path
    digest: str
    verdict: str
    run: str
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    versions: Mapping[str, str]

    @property
    def number(self) -> str:
        """Of the certificate; of the run where the laboratory gives none."""
        return self.details.number or f"run {self.run or self.digest[:12]}"

    @property
    @judged
    def assessment(self) -> Assessment:
        """That it can be signed, or what it lacks."""
        details, care = self.details, list[str]()
        if self.missing:
            care.append(
                f"The certificate does not state {', '.join(self.missing)}. Give them with "
                "--details (write a file to fill in with --new-details), or fill in by hand."
            )
        if not details.standards:
            care.append(
                "No reference standard is named, so the certificate claims no metrological "
                "traceability. Name the standards with their certificates in --details."
            )
        if self.without_uncertainty:
            care.append(self.without_uncertainty)
        bad = [d for d in self.decisions if d.outcome != "conforms"]
        care += [f"{d.name}: {d.outcome} (limit {d.limit_text})." for d in bad]
        return Assessment.of(f"certificate of {self.result}", care=care, facts=self.content.notes)

    @property
    def without_uncertainty(self) -> str:
        """Which named standards lack their uncertainty, in a sentence, or empty."""
        names = [one.name for one in self.details.standards if not one.uncertainty]
        return (
            f"The uncertainty of {listed(names)} is not stated: U includes of it only what the "
            "lines below the standards say."
            if names
            else ""
        )

    @property
    def missing(self) -> tuple[str, ...]:
        """What ISO/IEC 17025:2017, 7.8.2.1, asks for and nobody stated."""
        details = self.details
        stated = {
            "its number": details.number.replace(TO_BE_GIVEN, ""),
            "the laboratory": details.laboratory,
            "the customer": details.customer,
            "the item": details.item,
            "the day of the measurement": details.measured_on,
            "the day of issue": details.date,
            "the conditions": details.environment,
            "who approves it": details.approved_by,
        }
        return tuple(what for what, value in stated.items() if not value)


def certificate_of(path: Path, details: Details | None = None) -> Certificate:
    """The certificate of an answer that a command wrote.

    Args:
        path: its JSON, or the folder it is in.
        details: what the laboratory adds; nothing by default.

    Raises:
        InputError: unreadable, of no kind that has a certificate, changed since it was written,
            or a limit on what it does not tell.
        UnusableResultError: the answer says of itself that it must not be used.
    """
    details = Details() if details is None else details
    if is_folder(path):
        found = [path / name for name in RECORDS if (path / name).is_file()]
        path = found[0] if found else path / RECORDS[0]
    record = read_json_object(path)
    refuse_unusable(record, path)
    answer = answer_of(record, path)
    try:
        content = answer.content(record)
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as problem:
        raise InputError(
            f"an answer of {answer.name} without what a certificate needs ({problem})",
            f"the JSON that suta-calib {answer.name} of version {own_version()} writes",
            file=path,
            hint="compute it again",
        ) from None
    run, verdict = record.get("run") or {}, read_assessment(record)
    outputs = dict(run.get("sha256") or {})
    _refuse_changed(path, record, outputs)
    return Certificate(
        content,
        details,
        (*content.decisions, *_decisions(content, details)),
        path,
        sha256(read_input(path)).hexdigest(),
        f"{verdict.word.lower()}; {verdict.sentence}".rstrip(". "),
        str(run.get("id") or ""),
        dict(run.get("inputs") or {}),
        outputs,
        dict(record.get("versions") or {"suta_calib": own_version()}),
    )


def _decisions(content: Content, details: Details) -> list[Decision]:
    decisions, offered = [], content.judged
    for asked, limit in details.limits.items():
        if asked not in offered:
            raise InputError(
                f"a limit on {asked}",
                f"one of {', '.join(offered)}" if offered else "no limits: this answer has none",
                file=details.path,
                where=f"limits.{asked}",
                hint=did_you_mean(asked, offered),
            )
        quantity = offered[asked]
        decisions.append(Decision.of(quantity, float(stored(limit, quantity.unit))))
    return decisions


def _refuse_changed(path: Path, record: Mapping[str, Any], outputs: Mapping[str, str]) -> None:
    """Refuse an answer that was changed, or beside which a file of its run was."""
    # Earlier versions wrote none.
    written = (record.get("run") or {}).get("content")
    if written is not None and written != content_digest(record):
        raise InputError(
            "an answer that was changed since it was written",
            "the file as the run wrote it",
            file=path,
            hint="compute the answer again, or restore the file",
        )
    for name, digest in outputs.items():
        file = path.parent / Path(name).name
        if file.is_file() and sha256(read_input(file)).hexdigest() != digest:
            raise InputError(
                f"{file.name}, which was changed since {path.name} was written",
                "the files as the run wrote them",
                file=path,
                hint="compute the answer again, or restore the file",
            )
