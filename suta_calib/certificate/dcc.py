"""A certificate as JSON, by the structure of the Digital Calibration Certificate.

Names of elements and their nesting are those of the DCC's schema 3.3.0 (PTB, https://ptb.de/dcc),
and of the D-SI data model 2.2 for quantities with a unit. The DCC is XML: this is its content as
JSON, for programs. What the schema requires and nobody stated is null. What it has no element for
is in ``comment``: budgets, notes, and the SHA-256 of files.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from suta_calib.certificate.content import CertifiedValue, Decision, Outcome, ValueTable
from suta_calib.certificate.details import Environment, Item, Party, Standard
from suta_calib.certificate.issued import Certificate, own_version
from suta_calib.trust.uncertainty_budget import COVERAGE, UncertaintyBudget
from suta_calib.units import Unit, key, shown

Json = dict[str, Any]
SCHEMA: Final = "3.3.0"
# As the D-SI writes the units that a reader sees here.
UNITS: Final[dict[Unit, str]] = {
    "m": r"\milli\metre",
    "rad": r"\degree",
    "rad/Nm": r"\degree\newton\tothe{-1}\metre\tothe{-1}",
    "kg": r"\kilogram",
    "1/K": r"\ppm\kelvin\tothe{-1}",
    "m/s": r"\milli\metre\hour\tothe{-1}",
    "rad/s": r"\degree\hour\tothe{-1}",
    "s": r"\second",
    "px": r"\one",
    "1": r"\one",
    "%": r"\percent",
}
# The schema has no word for a limit that the uncertainty allows no decision on.
CONFORMITY: Final[dict[Outcome, str]] = {"conforms": "pass", "does not conform": "fail"}


def dcc_record(certificate: Certificate) -> Json:
    """The certificate as JSON, with numbers in mm and degrees as on paper."""
    content, details = certificate.content, certificate.details
    days = details.measured_on.split(" to ") if details.measured_on else [None]
    software = {**certificate.versions, "suta_calib": own_version()}
    persons = (("measured", details.operator), ("approved", details.approved_by))
    return {
        "schemaVersion": SCHEMA,
        "administrativeData": {
            "dccSoftware": {
                "software": [
                    {"name": _text(name), "release": release} for name, release in software.items()
                ]
            },
            "coreData": {
                "countryCodeISO3166_1": None,
                "usedLangCodeISO639_1": ["en"],
                "mandatoryLangCodeISO639_1": ["en"],
                "uniqueIdentifier": certificate.number,
                **_given(receiptDate=details.received_on),
                "beginPerformanceDate": days[0],
                "endPerformanceDate": days[-1],
                "performanceLocation": None,
                **_given(issueDate=details.issued_on),
            },
            "items": {"item": [_item(details.item)]},
            "calibrationLaboratory": {
                **_given(
                    calibrationLaboratoryCode=getattr(details.laboratory, "accreditation", "")
                ),
                "contact": _contact(details.laboratory),
            },
            "respPersons": {
                "respPerson": [
                    {"person": {"name": _text(name)}, "role": role} for role, name in persons
                ]
            },
            "customer": _contact(details.customer),
            **_given(
                statements=_list(
                    "statement", (_statement(d, content.rule) for d in certificate.decisions)
                )
            ),
        },
        "measurementResults": {
            "measurementResult": [
                {
                    "name": _text(content.title),
                    "description": _text(content.measurand),
                    "usedMethods": {
                        "usedMethod": [
                            {"name": _text(content.title), "description": _text(content.method)}
                        ]
                    },
                    **_given(
                        measuringEquipments=_list(
                            "measuringEquipment", map(_equipment, details.standards)
                        ),
                        influenceConditions=_list(
                            "influenceCondition", _conditions(details.environment)
                        ),
                    ),
                    "results": {"result": [_result(group) for group in content.groups]},
                }
            ]
        },
        "comment": {
            "measuredOn": details.measured_on or None,
            "issuedOn": details.issued_on or None,
            "referencesOfScale": [
                *(one.sentence for one in content.references),
                *certificate.standards_not_included,
            ],
            "budgets": [_budget(budget) for budget in content.budgets],
            "validation": dict(content.checked),
            "verdict": certificate.verdict,
            "notes": list(certificate.notes),
            "result": certificate.result.name,
            "sha256": certificate.digest,
            "run": certificate.run or None,
            "inputs": dict(certificate.inputs),
            "outputs": dict(certificate.outputs),
        },
    }


def _given(**elements: Any) -> Json:
    """Elements that the schema does not require, where they are stated."""
    return {name: value for name, value in elements.items() if value}


def _text(words: str | None) -> Json | None:
    """``textType`` and ``richContentType``."""
    return {"content": [words]} if words else None


def _list(element: str, entries: Iterator[Json]) -> Json | None:
    found = list(entries)
    return {element: found} if found else None


def _item(item: Item | None) -> Json:
    if item is None:
        return {"name": None, "identifications": None}
    return {
        "name": _text(item.name),
        **_given(manufacturer=item.maker and {"name": _text(item.maker)}, model=item.model),
        "identifications": _identified(item.serial),
    }


def _identified(serial: str) -> Json | None:
    return {"identification": [{"issuer": "manufacturer", "value": serial}]} if serial else None


def _contact(party: Party | None) -> Json:
    if party is None:
        return {"name": None, "location": None}
    place = {"further": _text(party.address)} if party.address else None
    return {"name": _text(party.name), "location": place}


def _equipment(standard: Standard) -> Json:
    stated = (
        ("certificate", standard.certificate),
        ("issued by", standard.issued_by),
        ("of", standard.of),
        ("uncertainty", standard.uncertainty.text if standard.uncertainty else "not stated"),
    )
    words = "; ".join(f"{what}: {said}" for what, said in stated if said)
    return {
        "name": _text(standard.name),
        "description": _text(words),
        **_given(identifications=_identified(standard.serial)),
    }


def _conditions(environment: Environment | None) -> Iterator[Json]:
    if environment is None:
        return
    for name, unit, limits in (
        ("temperature of the air", r"\degreecelsius", environment.temperature_c),
        ("relative humidity", r"\percent", environment.humidity_pct),
    ):
        if limits is not None:
            ends = zip(("lowest", "highest"), limits, strict=True)
            quantities = [
                {"name": _text(end), "real": {"value": value, "unit": unit}} for end, value in ends
            ]
            yield {"name": _text(name), "data": {"quantity": quantities}}
    for name, words in (("place", environment.place), ("remarks", environment.remarks)):
        if words:
            yield {"name": _text(name), "data": {"text": [_text(words)]}}


def _result(group: ValueTable) -> Json:
    return {
        "name": _text(group.title),
        **_given(description=_text(group.about)),
        "data": {"quantity": [_quantity(one) for one in group.quantities]},
    }


def _quantity(one: CertifiedValue) -> Json:
    alone = not math.isfinite(one.value)
    value = one.expanded if alone else one.value
    name = f"expanded uncertainty U (k = {one.factor:.2f}) of {one.name}" if alone else one.name
    real: Json = {"value": None if value is None else shown(value, one.unit)}
    real["unit"] = UNITS[one.unit]
    if one.expanded and not alone:
        real["measurementUncertaintyUnivariate"] = {
            "expandedMU": {
                "valueExpandedMU": shown(one.expanded, one.unit),
                "coverageFactor": one.factor,
                "coverageProbability": COVERAGE,
            }
        }
    return {"name": _text(name), **_given(description=_text(one.remark)), "real": real}


def _budget(budget: UncertaintyBudget) -> Mapping[str, Any]:
    unit = budget.unit
    return {
        "of": budget.of,
        "contributions": [
            {
                "source": part.source,
                "type": part.evaluation,
                "student": part.student,
                key("std", unit): shown(part.std, unit),
                "degreesOfFreedom": part.freedom if math.isfinite(part.freedom) else None,
            }
            for part in budget.contributions
        ],
        key("std", unit): shown(budget.std, unit),
        "degreesOfFreedom": budget.freedom if math.isfinite(budget.freedom) else None,
        "coverageFactor": budget.factor,
        key("expanded", unit): shown(budget.expanded, unit),
    }


def _statement(decision: Decision, rule: str) -> Json:
    limit = CertifiedValue("limit", decision.limit, decision.quantity.unit)
    return {
        "name": _text(f"conformity of {decision.quantity.name} with a limit"),
        "description": _text(rule),
        "declaration": _text(decision.words),
        **_given(conformity=CONFORMITY.get(decision.outcome)),
        "data": {"quantity": [_quantity(decision.quantity), _quantity(limit)]},
    }
