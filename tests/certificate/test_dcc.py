"""The JSON of a certificate has the elements of the DCC, nested and in order as in its schema.

The schema 3.3.0 of the PTB is under the LGPL and is not here. These are its facts, for the elements
that a certificate uses: the children of each in order, those that the schema requires with a mark.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cli_job import cli

from suta_calib.certificate import certificate_of, dcc_record, read_details
from suta_calib.certificate.content import CertifiedValue, Decision
from suta_calib.certificate.dcc import UNITS
from suta_calib.certificate.details import EXAMPLE

TEXT = "content+!"
CONTACT = "name! eMail phone fax link location! descriptionData"
DATA = "text+ formula+ byteData+ xml+ quantity+ list+"
METHODS = "usedMethod+!"
# By the path of an element; + may repeat, ! is required.
ELEMENTS = {
    "": "schemaVersion! administrativeData! measurementResults! comment document",
    "administrativeData": "dccSoftware! refTypeDefinitions coreData! items! calibrationLaboratory! "
    "respPersons! customer! statements",
    "dccSoftware": "software+!",
    "software": "name! release! type description",
    "coreData": "countryCodeISO3166_1! usedLangCodeISO639_1+! mandatoryLangCodeISO639_1+! "
    "uniqueIdentifier! identifications receiptDate beginPerformanceDate! endPerformanceDate! "
    "performanceLocation! issueDate reportAmendedSubstituted previousReport",
    "items": "name equipmentClass+ description owner manufacturer identifications item+!",
    "item": "name! equipmentClass+ description owner installedSoftwares manufacturer model "
    "identifications! itemQuantities subItems",
    "identifications": "identification+!",
    "identification": "issuer! value! name",
    "calibrationLaboratory": "calibrationLaboratoryCode contact! cryptElectronicSeal "
    "cryptElectronicSignature cryptElectronicTimeStamp",
    "contact": CONTACT,
    "customer": CONTACT,
    "manufacturer": "name! eMail phone fax link location descriptionData",
    "person": "name! eMail phone fax link location descriptionData",
    "location": "city+ countryCode+ postCode+ postOfficeBox+ state+ street+ streetNo+ further "
    "positionCoordinates+",
    "respPersons": "respPerson+!",
    "respPerson": "person! description role mainSigner cryptElectronicSeal "
    "cryptElectronicSignature cryptElectronicTimeStamp",
    "statements": "statement+!",
    "statement": "name description countryCodeISO3166_1+ convention traceable norm+ reference+ "
    "link+ declaration valid validXMLList date period respAuthority conformity "
    "conformityXMLList data nonSIDefinition nonSIUnit location",
    "measurementResults": "usedMethods usedSoftware measuringEquipments influenceConditions "
    "measurementMetaData measurementResult+!",
    "measurementResult": "name! description usedMethods usedSoftware measuringEquipments "
    "influenceConditions results! measurementMetaData",
    "usedMethods": METHODS,
    "usedMethod": "name! description norm+ reference+ link+ usedMethodQuantities",
    "measuringEquipments": "name equipmentClass+ description owner identifications "
    "measuringEquipment+!",
    "measuringEquipment": "name! equipmentClass+ description certificate manufacturer model "
    "identifications measuringEquipmentQuantities installedSoftware",
    "influenceConditions": "influenceCondition+!",
    "influenceCondition": "name! description status certificate data!",
    "results": "result+!",
    "result": "name! description data!",
    "data": DATA,
    "quantity": "name description real relativeUncertainty usedMethods usedSoftware "
    "measuringEquipments influenceConditions measurementMetaData",
    # Of the D-SI, 2.2.
    "real": "label quantityType value! unit! significantDigit dateTime "
    "measurementUncertaintyUnivariate",
    "measurementUncertaintyUnivariate": "expandedMU standardMU coverageIntervalMU",
    "expandedMU": "valueExpandedMU! coverageFactor! coverageProbability! distribution",
    **dict.fromkeys(("name", "description", "declaration", "further", "text"), TEXT),
}
CONFORMITY = {"pass", "fail", "conditionalPass", "conditionalFail", "noPass", "noFail"}


def faults(record: Mapping[str, Any], name: str = "", path: str = "") -> Iterator[str]:
    """What of a record the schema would refuse, but for what is null: nobody stated it."""
    if name not in ELEMENTS:
        yield f"{path}: no element of the DCC"
        return
    children = [child.rstrip("+!") for child in ELEMENTS[name].split()]
    many = {child.rstrip("+!") for child in ELEMENTS[name].split() if "+" in child}
    for child in ELEMENTS[name].split():
        if child.endswith("!") and child.rstrip("+!") not in record:
            yield f"{path}: lacks {child}"
    at = [children.index(key) if key in children else -1 for key in record]
    if -1 in at or at != sorted(at):
        yield f"{path}: {', '.join(record)} in place of {', '.join(children)}"
    for key, value in record.items():
        if name == "" and key == "comment":
            continue
        if isinstance(value, list) != (key in many) and value is not None:
            yield f"{path}/{key}: {'one' if key in many else 'a list'}"
        for k, one in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(one, Mapping):
                yield from faults(one, key, f"{path}/{key}[{k}]")
            elif key in ELEMENTS and one is not None:
                yield f"{path}/{key}: {one!r} in place of elements"


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    out = tmp_path_factory.mktemp("pivot")
    assert cli("pivot", repository / "data" / "poses" / "pivot.csv", "--out", out) == 0
    return out


@pytest.mark.parametrize("stated", [EXAMPLE, "number: A\n", "item: {name: arm}\n"])
def test_elements_are_those_of_the_schema(stated: str, answered: Path, tmp_path: Path) -> None:
    details = tmp_path / "d.yaml"
    details.write_text(stated.replace("validation_rms_mm: 0.5", "rms_mm: 0.1"), encoding="utf-8")
    certificate = certificate_of(answered, read_details(details))
    undecided = Decision.of(CertifiedValue("q", 1e-3, "m", 1e-4), 1e-3)
    record = dcc_record(replace(certificate, decisions=(*certificate.decisions, undecided)))
    json.dumps(record, allow_nan=False)
    assert list(faults(record)) == []
    said = record["administrativeData"]["statements"]["statement"]
    assert {one["conformity"] for one in said if "conformity" in one} <= CONFORMITY
    assert "conformity" not in said[-1]
    assert said[-1]["declaration"] == {"content": ["no decision"]}


def test_what_the_schema_does_not_have_is_found(answered: Path) -> None:
    record = dcc_record(certificate_of(answered))
    del record["administrativeData"]["items"]
    record["measurementResults"]["measurementResult"][0]["budgets"] = []
    record["measurementResults"]["measurementResult"][0]["results"]["result"] = {}
    found = " ".join(faults(record))
    for fault in ("lacks items", "budgets", "result: one"):
        assert fault in found


def test_days_are_dates_and_a_period_has_two(answered: Path, tmp_path: Path) -> None:
    details = tmp_path / "d.yaml"
    details.write_text(
        'measured_on: 2026-11-26 to 2026-11-27\nreceived_on: "2026-11-20"\n', "utf-8"
    )
    record = dcc_record(certificate_of(answered, read_details(details)))
    core = record["administrativeData"]["coreData"]
    assert core["beginPerformanceDate"] == "2026-11-26"
    assert core["endPerformanceDate"] == "2026-11-27"
    assert core["receiptDate"] == "2026-11-20"
    assert "issueDate" not in core


def test_every_unit_has_one_of_the_d_si() -> None:
    assert all(unit.startswith("\\") for unit in UNITS.values())
