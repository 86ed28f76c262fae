"""A certificate on paper: PDF with selectable text and embedded fonts, by fpdf2."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

import matplotlib as mpl
from fpdf import FPDF
from fpdf.enums import XPos, YPos
from fpdf.fonts import FontFace

from suta_calib.certificate.content import CertifiedValue, Decision, ValueTable
from suta_calib.certificate.details import Party
from suta_calib.certificate.issued import Certificate
from suta_calib.trust.uncertainty_budget import UncertaintyBudget
from suta_calib.units import NOTHING, rounded_text, shown, std_text, unit_name

Paper = Literal["a4", "letter"]
MARGIN: Final = 20.0
# Points.
BODY: Final = 9
# What is to be filled in by hand.
BLANK: Final = "_" * 32


def pdf_bytes(certificate: Certificate, paper: Paper = "a4") -> bytes:
    """The certificate as a PDF.

    Args:
        certificate: what it says.
        paper: size of the pages.
    """
    sheet = _Sheet(certificate, paper)
    sheet.write_all()
    return bytes(sheet.output())


class _Sheet(FPDF):
    """Pages with the number of the certificate at the top and the page at the bottom."""

    def __init__(self, certificate: Certificate, paper: Paper) -> None:
        super().__init__(format=paper)
        self._certificate = certificate
        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
        for style, name in (("", "DejaVuSans"), ("B", "DejaVuSans-Bold")):
            self.add_font("sans", style, fonts / f"{name}.ttf")
        self.set_margins(MARGIN, MARGIN)
        self.set_auto_page_break(auto=True, margin=MARGIN)
        self.set_title(f"{certificate.content.title}, {certificate.number}")
        self.set_creator("suta_calib")
        self.set_lang("en")
        # The same certificate is the same file.
        self.set_creation_date(datetime(1970, 1, 1, tzinfo=UTC))
        self.add_page()

    # ── every page ──────────────────────────────────────────────────────────────────────────
    def header(self) -> None:
        """Number of the certificate, from the second page on."""
        if self.page_no() > 1:
            self.set_font("sans", "", 8)
            self.set_text_color(90)
            self.cell(0, 5, f"Certificate {self._certificate.number}", align="R")
            self.ln(9)
            self.set_text_color(0)

    def footer(self) -> None:
        """Page x of y."""
        self.set_y(-15)
        self.set_font("sans", "", 7)
        self.set_text_color(90)
        words = "May be copied as a whole only. Results hold for the item as it was calibrated."
        self.cell(0, 5, words)
        self.set_x(MARGIN)
        self.cell(0, 5, f"page {self.page_no()} of {{nb}}", align="R")
        self.set_text_color(0)

    # ── parts ───────────────────────────────────────────────────────────────────────────────
    def write_all(self) -> None:
        """All sections, in the order of ISO/IEC 17025:2017, 7.8.2 and 7.8.4."""
        certificate, content = self._certificate, self._certificate.content
        self._title()
        self._who()
        self._heading("Measurand")
        self._paragraph(content.measurand)
        self._heading("Method")
        self._paragraph(content.method)
        self._conditions()
        self._standards()
        self._heading("Results")
        for group in content.groups:
            self._group(group)
        self._paragraph(
            "U is the expanded uncertainty: the standard uncertainty times the coverage factor k, "
            "for a coverage of about 95 %. A dash: no uncertainty is stated for this figure."
        )
        for budget in content.budgets:
            self._budget(budget)
        if content.checked:
            self._heading("Validation")
            self._table(("what", "found"), content.checked, (6, 5))
        self._conformity(certificate.decisions)
        self._heading("Notes")
        self._paragraph(f"The software's verdict on the answer: {certificate.verdict}.")
        for note in content.notes:
            self._paragraph(f"• {note}")
        self._origin()
        self._signatures()

    def _title(self) -> None:
        certificate = self._certificate
        self.set_font("sans", "", 9)
        self.cell(0, 5, "Certificate", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "B", 16)
        self.multi_cell(0, 8, certificate.content.title, new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "", BODY)
        self.ln(2)

    def _who(self) -> None:
        details = self._certificate.details
        item = details.item
        described = (
            ", ".join(
                filter(
                    None,
                    (item.name, item.maker, item.model, item.serial and f"serial {item.serial}"),
                )
            )
            if item
            else ""
        )
        self._table(
            None,
            (
                ("number", self._certificate.number),
                ("laboratory", _party(details.laboratory)),
                ("customer", _party(details.customer)),
                ("item", described or BLANK),
                ("measured on", details.measured_on or BLANK),
                ("issued on", details.date or BLANK),
            ),
            (1, 4),
        )

    def _conditions(self) -> None:
        environment = self._certificate.details.environment
        self._heading("Conditions")
        if environment is None:
            self._paragraph(f"Not stated. Place, temperature, humidity: {BLANK}")
            return
        warm, humid = environment.temperature_c, environment.humidity_pct
        rows = (
            ("place", environment.place),
            ("temperature of the air", warm and f"{warm[0]:g} to {warm[1]:g} °C"),
            ("relative humidity", humid and f"{humid[0]:g} to {humid[1]:g} %"),
            ("remarks", environment.remarks),
        )
        self._table(None, [(what, said) for what, said in rows if said], (1, 3))

    def _standards(self) -> None:
        details, content = self._certificate.details, self._certificate.content
        self._heading("Reference standards and traceability")
        if details.standards:
            self._table(
                ("standard", "serial", "certificate", "issued by", "its uncertainty"),
                [
                    tuple(
                        said or NOTHING
                        for said in (s.name, s.serial, s.certificate, s.issued_by, s.uncertainty)
                    )
                    for s in details.standards
                ],
                (3, 2, 3, 2, 3),
            )
            self._paragraph(
                "Chain: the results rest on the lengths of these standards, and these on the SI by "
                "the certificates named."
            )
        else:
            self._paragraph(
                "No reference standard with a certificate is named: no metrological traceability "
                "is claimed."
            )
        for sentence in content.standards:
            self._paragraph(f"In the uncertainty: {sentence}.")

    def _group(self, group: ValueTable) -> None:
        self._heading(group.title, small=True)
        if group.about:
            self._paragraph(group.about)
        remarks = any(one.remark for one in group.quantities)
        heads = ("quantity", "value", "U", "k", "unit", *(("remark",) if remarks else ()))
        rows = [(*_measured(one), *((one.remark,) if remarks else ())) for one in group.quantities]
        widths = (5, 2, 2, 1, 1, 5) if remarks else (6, 3, 3, 1, 1)
        self._table(heads, rows, widths, numbers={1, 2, 3})

    def _budget(self, budget: UncertaintyBudget) -> None:
        unit = budget.unit
        self._heading(f"Uncertainty budget: {budget.of}", small=True)
        rows: list[tuple[str, ...]] = [
            (
                part.source,
                part.evaluation,
                std_text(part.std, unit, with_unit=False),
                f"{part.freedom:.0f}" if math.isfinite(part.freedom) else "∞",
            )
            for part in (*budget.contributions, budget.combined)
        ]
        rows.append(
            (
                f"expanded, k = {budget.factor:.2f}",
                "",
                std_text(budget.expanded, unit, with_unit=False),
                "",
            )
        )
        heads = ("source", "type", f"standard uncertainty, {unit_name(unit)}", "deg. of freedom")
        self._table(heads, rows, (7, 1, 3, 2), numbers={2, 3})

    def _conformity(self, decisions: Sequence[Decision]) -> None:
        if not decisions:
            return
        self._heading("Statement of conformity")
        self._table(
            ("quantity", "value", "U", "limit", "unit", "decision"),
            [
                (
                    d.name,
                    rounded_text(d.value, d.expanded, d.unit),
                    std_text(d.expanded, d.unit, with_unit=False),
                    f"{shown(d.limit, d.unit):g}",
                    unit_name(d.unit),
                    d.outcome,
                )
                for d in decisions
            ],
            (5, 2, 2, 2, 1, 3),
            numbers={1, 2, 3},
        )
        self._paragraph(
            "Decision rule: a guard band as wide as U (JCGM 106:2012, 8.3). A value conforms if "
            "its size and U together keep the limit. It does not conform if its size less U "
            "exceeds the limit. Between them no decision is made."
        )

    def _origin(self) -> None:
        certificate = self._certificate
        self._heading("Software and data")
        versions = ", ".join(f"{name} {v}" for name, v in certificate.versions.items())
        rows = [("computed with", versions), ("run", certificate.run or NOTHING)]
        rows.append((certificate.result.name, f"SHA-256 {certificate.digest}"))
        rows += [
            (Path(name).name, f"SHA-256 {digest}")
            for name, digest in {**certificate.inputs, **certificate.outputs}.items()
        ]
        self._table(None, rows, (2, 5))

    def _signatures(self) -> None:
        details = self._certificate.details
        if self.will_page_break(40):
            self.add_page()
        self._heading("Signatures")
        self._table(
            ("", "name", "date", "signature"),
            [
                ("measured", details.operator, "", ""),
                ("approved", details.approved_by, details.date, ""),
            ],
            (2, 4, 2, 5),
            height=9,
            borders="ALL",
        )

    # ── what they are made of ───────────────────────────────────────────────────────────────
    def _heading(self, words: str, *, small: bool = False) -> None:
        # Never alone at the end of a page.
        if self.will_page_break(24):
            self.add_page()
        self.ln(2 if small else 4)
        self.set_font("sans", "B", 9.5 if small else 11)
        self.multi_cell(0, 5.5, words, new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.set_font("sans", "", BODY)
        self.ln(0.5)

    def _paragraph(self, words: str) -> None:
        self.multi_cell(0, 4.6, words, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
        self.ln(1)

    def _table(
        self,
        heads: Sequence[str] | None,
        rows: Sequence[Sequence[str]],
        widths: Sequence[int],
        *,
        numbers: Collection[int] = (),
        height: float = 4.6,
        borders: str = "HORIZONTAL_LINES",
    ) -> None:
        self.set_font("sans", "", 8)
        bold = FontFace(emphasis="BOLD")
        with self.table(
            col_widths=tuple(widths),
            text_align=tuple("RIGHT" if k in numbers else "LEFT" for k in range(len(widths))),
            borders_layout=borders if heads else "NONE",
            first_row_as_headings=heads is not None,
            headings_style=bold,
            line_height=height,
            padding=(0.4, 1.0),
        ) as table:
            for row in ([heads] if heads else []) + [*rows]:
                cells = table.row()
                for cell in row:
                    cells.cell(str(cell))
        self.set_font("sans", "", BODY)
        self.ln(1)


def _party(party: Party | None) -> str:
    if party is None:
        return BLANK
    return ", ".join(filter(None, (party.name, party.address, party.accreditation)))


def _measured(one: CertifiedValue) -> tuple[str, str, str, str, str]:
    """Name, value, U, k and unit; to the last of two digits of U (JCGM 100:2008, 7.2.6)."""
    unit, spread = one.unit, one.expanded or 0.0
    value = rounded_text(one.value, spread, unit)
    if not spread:
        return one.name, value, NOTHING, NOTHING, unit_name(unit)
    return (
        one.name,
        value,
        std_text(spread, unit, with_unit=False),
        f"{one.factor:.2f}",
        unit_name(unit),
    )
