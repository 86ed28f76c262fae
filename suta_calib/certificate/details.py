"""``certificate.yaml``: what only the laboratory knows: who measured, and with which standards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from suta_calib.display import Displayable
from suta_calib.errors import InputError
from suta_calib.measurements.fields import (
    TEXT,
    Fields,
    Value,
    fields_of,
    keyed,
    mapping,
    read_as,
    rows,
)
from suta_calib.measurements.yaml_file import YamlSection, read_yaml


def _range(section: YamlSection, name: str) -> tuple[float, float]:
    low, high = section.numbers(name, 2)
    if low > high:
        raise section.refuse(f"{low:g} above {high:g}", "the smaller number first", at=(name,))
    return low, high


RANGE: Final = Value("lowest, highest", _range)


@dataclass(frozen=True)
class Party(Displayable):
    """A laboratory, or who asked for the certificate."""

    name: str = keyed(TEXT, "Name.")
    address: str = keyed(TEXT, "Postal address.", "")
    accreditation: str = keyed(TEXT, "Of a laboratory: body and number of its accreditation.", "")


@dataclass(frozen=True)
class Item(Displayable):
    """What was calibrated."""

    name: str = keyed(TEXT, "What it is.")
    maker: str = keyed(TEXT, "Who made it.", "")
    model: str = keyed(TEXT, "Its type.", "")
    serial: str = keyed(TEXT, "Its serial number.", "")


@dataclass(frozen=True)
class Standard(Displayable):
    """A reference standard: an artefact, a tracker, a board."""

    name: str = keyed(TEXT, "What it is.")
    serial: str = keyed(TEXT, "Its serial number.", "")
    certificate: str = keyed(TEXT, "Number and date of its own certificate.", "")
    issued_by: str = keyed(TEXT, "Who issued that.", "")
    uncertainty: str = keyed(TEXT, "Its uncertainty, as that certificate states it.", "")


@dataclass(frozen=True)
class Environment(Displayable):
    """Where and how warm it was."""

    place: str = keyed(TEXT, "Where it was measured.", "")
    temperature_c: tuple[float, float] | None = keyed(RANGE, "Of the air, degrees Celsius.", None)
    humidity_pct: tuple[float, float] | None = keyed(RANGE, "Relative, per cent.", None)
    remarks: str = keyed(TEXT, "What else may have mattered.", "")


def _limits(section: YamlSection, name: str) -> dict[str, float]:
    below = section.section(name)
    return {str(key): below.number(str(key), "positive") for key in below.data}


@dataclass(frozen=True)
class Details(Displayable):
    """What only the laboratory knows; what it leaves out is a blank line on the paper."""

    number: str = keyed(TEXT, "Number of the certificate.", "")
    date: str = keyed(TEXT, "Day of issue, as 2026-11-27.", "")
    measured_on: str = keyed(TEXT, "Day or days of the measurement.", "")
    laboratory: Party | None = keyed(mapping(Party), "Who measured.", None)
    customer: Party | None = keyed(mapping(Party), "Who asked for it.", None)
    item: Item | None = keyed(mapping(Item), "What was calibrated.", None)
    environment: Environment | None = keyed(mapping(Environment), "The conditions.", None)
    standards: tuple[Standard, ...] = keyed(
        rows(lambda section: read_as(Standard, section), fields_of(Standard)),
        "Reference standards.",
        (),
    )
    limits: Mapping[str, float] = keyed(
        Value("numbers by name", _limits),
        "Limits to decide on, such as validation_rms_mm: 0.5. A name that the answer does not have "
        "is refused with a list of those that it has.",
        dict,
    )
    operator: str = keyed(TEXT, "Who measured, by name.", "")
    approved_by: str = keyed(TEXT, "Who signs, by name.", "")
    path: Path | None = None


DETAILS_KEYS: Final[Fields] = fields_of(Details)


def read_details(path: Path) -> Details:
    """Read a ``certificate.yaml``.

    Raises:
        InputError: unreadable, or with keys or values that it cannot have.
    """
    section = YamlSection(read_yaml(path), InputError)
    return read_as(Details, section, path=path)


TO_BE_GIVEN: Final = "to be given"
# All that can be stated.
EXAMPLE: Final = """\
number: 2026-001
date: "2026-11-27"
measured_on: "2026-11-26"
laboratory: {name: Name, address: "Street, town, country"}
customer: {name: Name, address: "Street, town, country"}
item: {name: measuring arm, maker: Maker, model: Model, serial: "0001"}
environment:
  place: Room
  temperature_c: [19.8, 20.4]
  humidity_pct: [40, 50]
standards:
  - {name: artefact, serial: "0001", certificate: "number, day", issued_by: Laboratory,
     uncertainty: "2 um (k = 2)"}
limits: {validation_rms_mm: 0.5}
operator: Name
approved_by: Name
"""


def details_to_fill_in() -> str:
    """Such a file, with everything commented out but the number, which is yet to be given."""
    about = (
        "# What a certificate says beside the results:\n"
        "#   suta-calib certificate RESULT --details THIS_FILE --out certificate.pdf\n"
        "# Remove the # in front of what you state. The rest is a blank line on the paper.\n"
    )
    _, *others = EXAMPLE.splitlines()
    return about + f'number: "{TO_BE_GIVEN}"\n' + "".join(f"# {line}\n" for line in others)
