"""A certificate: an answer, what the laboratory adds, and where all of it came from."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from suta_calib.assessment import Assessment, judged, read_assessment, refuse_unusable
from suta_calib.certificate.answer import answer_of
from suta_calib.certificate.content import Content, Decision, Reference
from suta_calib.certificate.details import TO_BE_GIVEN, Details, Standard
from suta_calib.certificate.lengths import EXPECTED
from suta_calib.display import Displayable
from suta_calib.errors import InputError, did_you_mean
from suta_calib.exchange.cells import is_folder
from suta_calib.exchange.result import content_digest
from suta_calib.inputs import read_input
from suta_calib.tracking.uncertainty import read_json_object
from suta_calib.units import mm, stored
from suta_calib.words import listed

# Names of the JSON that commands write, in a folder that is given in its place.
RECORDS: Final = (
    *("result.json", "iso10360.json", "repeatability.json", "certify.json", "detect.json"),
)
# Up to which length a standard's constant part may exceed what U includes, m.
METRE: Final = 1.0
# Of a sentence that tells somebody what to do: it begins with a verb, or names a command or key.
ADVICE: Final = re.compile(
    r"^(?:(?:To determine more|If so|Then|Otherwise|Please)\b.*|"
    r"(?:Add|Calibrate|Certify|Check|Choose|Compare|Compute|Estimate|Find|Fit|Give|Leave|Look|"
    r"Measure|Name|Raise|Remove|Repeat|Run|See|Set|State|Take|Touch|Try|Turn|Use|Write)\s.*)"
    r"|\bsuta-calib [a-z]|\bprior_(?:mm|deg)\b"
)
OPTION: Final = re.compile(r" \(--[a-z][^)]*\)")


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
        if lacking := self._shortfalls(lacking=True):
            care.append(
                f"{' '.join(lacking)} State the standard's uncertainty for the "
                "measurement (accuracy in an artefact or instrument, --scale-ppm) and compute the "
                "answer again."
            )
        if self.standards_of_none:
            care.append(
                f"{listed(self.standards_of_none)}: not compared with U, because of: is not given. "
                f"Give it: {', '.join(_names(self.content.references))}."
            )
        bad = [d for d in self.decisions if d.outcome != "conforms"]
        care += [f"{d.quantity.name}: {d.words} (limit {d.limit_text})." for d in bad]
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
    def notes(self) -> tuple[str, ...]:
        """Facts about the answer, without what its operator should do."""
        return tuple(filter(None, map(facts_of, self.content.notes)))

    @property
    def standards_not_included(self) -> tuple[str, ...]:
        """Sentences on standards whose uncertainty U includes not at all, or not everywhere."""
        return (*self._shortfalls(lacking=True), *self._shortfalls(lacking=False))

    def _shortfalls(self, *, lacking: bool) -> tuple[str, ...]:
        pairs = _pairs(self.content.references, self.details.standards)
        found = (_shortfall(*pair) for pair in pairs)
        return tuple(words for words, lacks in found if words and lacks == lacking)

    @property
    def standards_of_none(self) -> tuple[str, ...]:
        """Names of standards of length that do not say of which reference they are."""
        names = _names(self.content.references)
        return tuple(
            one.name
            for one in self.details.standards
            if len(names) > 1 and not one.of and one.uncertainty and one.uncertainty.std
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
            "the day of issue": details.issued_on,
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
    lacking = _lacking(content, details)
    decisions = (*content.decisions, *_decisions(content, details))
    run, verdict = record.get("run") or {}, read_assessment(record)
    # What an answer decided itself may be undecided here.
    sentence = "limits: see the statement of conformity" if content.decisions else verdict.sentence
    outputs = dict(run.get("sha256") or {})
    _refuse_changed(path, record, outputs)
    return Certificate(
        content,
        details,
        tuple(decision.without(lacking) for decision in decisions),
        path,
        sha256(read_input(path)).hexdigest(),
        f"{verdict.word.lower()}; {sentence}".rstrip(". "),
        str(run.get("id") or ""),
        dict(run.get("inputs") or {}),
        outputs,
        dict(record.get("versions") or {"suta_calib": own_version()}),
    )


def _decisions(content: Content, details: Details) -> list[Decision]:
    decisions, offered = [], content.judged
    for asked, limit in details.limits.items():
        if asked not in offered:
            raise details.refuse(
                f"a limit on {asked}",
                f"one of {', '.join(offered)}" if offered else "no limits: this answer has none",
                ("limits", asked),
                did_you_mean(asked, offered),
            )
        quantity = offered[asked]
        decided = Decision.of(quantity, float(stored(limit, quantity.unit)))
        about = f"{quantity.name}: {quantity.remark}" if quantity.remark else ""
        decisions.append(replace(decided, about=about))
    return decisions


def _names(references: Sequence[Reference]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(one.name for one in references if one.name))


def _pairs(
    references: Sequence[Reference], standards: Sequence[Standard]
) -> Iterator[tuple[Reference, Standard]]:
    """Every standard of length with the references that it is of."""
    names = _names(references)
    for standard in standards:
        of = standard.of or (names[0] if len(names) == 1 else "")
        if of and standard.uncertainty is not None and standard.uncertainty.std is not None:
            yield from ((one, standard) for one in references if one.name == of)


def _shortfall(reference: Reference, standard: Standard) -> tuple[str, bool]:
    """What to say of a standard that U does not cover, and whether U lacks it.

    U that covers it from some length up to one metre on has it.
    """
    stated = standard.uncertainty
    if stated is None or stated.std is None:
        return "", False
    words = f"the uncertainty of the standard {standard.name} ({stated.text})"
    if reference.included is None:
        return f"U does not include {words}.", True
    least, most = stated.std.lengths_within(reference.included)
    if math.isnan(least):
        return f"U does not include {words}: the answer was computed with a smaller one.", True
    if most < math.inf:
        return f"U includes {words} for lengths up to {mm(most):,.0f} mm only.", most < METRE
    if least > 0.0:
        return f"U includes {words} for lengths above {mm(least):,.0f} mm only.", least > METRE
    return "", False


def _lacking(content: Content, details: Details) -> dict[str, str]:
    """What U lacks, in words, by the name of the reference.

    Raises:
        InputError: a standard is of a reference that the answer does not have, or is no length.
    """
    names = _names(content.references)
    for k, standard in enumerate(details.standards):
        if standard.of and standard.of not in names:
            raise details.refuse(
                f"a standard of {standard.of}",
                f"one of {', '.join(names)}: what this answer rests on",
                ("standards", k, "of"),
                did_you_mean(standard.of, names),
            )
        if standard.of and standard.uncertainty and standard.uncertainty.std is None:
            raise details.refuse(
                f"{standard.uncertainty.text}, which is no length",
                f"{EXPECTED}, of a standard of lengths",
                ("standards", k, "uncertainty"),
                "leave of: out for other standards, such as thermometers",
            )
    lacking = {
        one.name: f"the uncertainty of the {one.name}"
        for one in content.references
        if one.included is None
    }
    for reference, standard in _pairs(content.references, details.standards):
        if _shortfall(reference, standard)[1]:
            lacking[reference.name] = f"the uncertainty of the standard {standard.name}"
    return lacking


def facts_of(note: str) -> str:
    """A note without its advice: what an operator should run, state or measure."""
    sentences = re.split(r"(?<=[.!?])\s+(?=[A-Z±])", note.strip())
    kept = [OPTION.sub("", one) for one in sentences if not ADVICE.search(one)]
    return " ".join(kept)


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
