"""A certificate as JSON, by the structure of the Digital Calibration Certificate.

Names of elements are those of the DCC's schema 3.3.0 (PTB, https://ptb.de/dcc) and of the D-SI data
model 2.2 for quantities with a unit. The DCC is XML: this is its content as JSON, for programs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from suta_calib.certificate.content import CertifiedValue, Decision, ValueTable
from suta_calib.certificate.details import Party
from suta_calib.certificate.issued import Certificate, own_version
from suta_calib.trust.uncertainty_budget import COVERAGE, UncertaintyBudget
from suta_calib.units import Unit, key, shown

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


def dcc_record(certificate: Certificate) -> dict[str, Any]:
    """The certificate as JSON, with numbers in mm and degrees as on paper."""
    content, details = certificate.content, certificate.details
    return {
        "schemaVersion": SCHEMA,
        "administrativeData": {
            "dccSoftware": [
                {"name": name, "release": release}
                for name, release in {**certificate.versions, "suta_calib": own_version()}.items()
            ],
            "coreData": {
                "uniqueIdentifier": certificate.number,
                "beginPerformanceDate": details.measured_on or None,
                "issueDate": details.date or None,
            },
            "items": [_plain(details.item)],
            "calibrationLaboratory": _party(details.laboratory),
            "respPersons": [
                {"role": role, "name": name or None}
                for role, name in (
                    ("measured", details.operator),
                    ("approved", details.approved_by),
                )
            ],
            "customer": _party(details.customer),
            "statements": [_decision(decision) for decision in certificate.decisions],
        },
        "measurementResults": {
            "name": content.title,
            "description": content.measurand,
            "usedMethods": [content.method],
            "measuringEquipments": [_plain(standard) for standard in details.standards],
            "referencesOfScale": list(content.standards),
            "influenceConditions": _plain(details.environment),
            "results": [_group(group) for group in content.groups],
            "budgets": [_budget(budget) for budget in content.budgets],
            "validation": dict(content.checked),
        },
        "comment": list(content.notes),
        "document": {
            "result": certificate.result.name,
            "sha256": certificate.digest,
            "run": certificate.run or None,
            "inputs": dict(certificate.inputs),
            "outputs": dict(certificate.outputs),
        },
    }


def _plain(part: Any) -> Any:
    return None if part is None else {k: v or None for k, v in asdict(part).items()}


def _party(party: Party | None) -> Mapping[str, Any] | None:
    plain: Mapping[str, Any] | None = _plain(party)
    return plain


def _group(group: ValueTable) -> dict[str, Any]:
    return {"name": group.title, "data": [_quantity(one) for one in group.quantities]}


def _quantity(one: CertifiedValue) -> dict[str, Any]:
    value = shown(one.value, one.unit) if math.isfinite(one.value) else None
    real: dict[str, Any] = {"value": value, "unit": UNITS[one.unit]}
    if one.expanded is not None:
        real["measurementUncertaintyUnivariate"] = {
            "expandedMU": {
                "valueExpandedMU": shown(one.expanded, one.unit),
                "coverageFactor": one.factor,
                "coverageProbability": COVERAGE,
            }
        }
    return {"name": one.name, "description": one.remark or None, "real": real}


def _budget(budget: UncertaintyBudget) -> dict[str, Any]:
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


def _decision(decision: Decision) -> dict[str, Any]:
    unit = decision.unit
    return {
        "data": decision.name,
        key("value", unit): shown(decision.value, unit),
        key("expanded", unit): shown(decision.expanded, unit),
        key("limit", unit): shown(decision.limit, unit),
        "decisionRule": "guard band as wide as the expanded uncertainty (JCGM 106:2012, 8.3)",
        "conformity": decision.outcome,
    }
