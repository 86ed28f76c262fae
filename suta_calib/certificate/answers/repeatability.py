"""The repeatability of an arm on paper."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from suta_calib.certificate.answer import CertifiedAnswer, Record, not_stated, si
from suta_calib.certificate.content import CertifiedValue, Content, ValueTable
from suta_calib.units import key

ASYMMETRIC: Final = (
    "The confidence interval of a scatter is not symmetric: U is the way from the value to its "
    "farther end, and k is nominal."
)


class RepeatabilityOnPaper(CertifiedAnswer):
    """What ``repeatability`` wrote about visits to a point."""

    name = "repeatability"
    mark = "visits"

    def content(self, record: Record) -> Content:
        """Pose repeatability RP and the RMS deviation, of all visits and of each protocol."""
        confidence = float(record["confidence_pct"])
        parts = {"All visits": record["position"]}
        parts |= {f"Protocol {n}": part for n, part in (record.get("protocols") or {}).items()}
        groups = [
            ValueTable(title, tuple(_figures(part, confidence)), ASYMMETRIC)
            for title, part in parts.items()
        ]
        return Content(
            title="Repeatability of a measuring arm",
            measurand=(
                "Repeatability RP of the position of the tip (mean distance from the barycentre "
                "plus three standard deviations), and root mean square distance from it."
            ),
            method="Visits to one point, evaluated after ISO 9283:1998, 7.2.",
            groups=tuple(groups),
            judged={key(row.name, row.unit): row for row in groups[0].quantities},
            references=(
                not_stated("arm", "kinematic model of the arm, by which lengths are known"),
            ),
            notes=tuple(record["verdict"]["notes"]),
        )


def _figures(part: Record, confidence: float) -> Iterator[CertifiedValue]:
    for name, told in (("RP", "rp"), ("RMS", "rms")):
        low, high = part[f"{told}_interval_mm"]
        remark = (
            f"{confidence:.0f} % confidence interval {low:.3f} to {high:.3f} mm, "
            "U is its farther side"
        )
        value = si(part, told, "m")
        # A sample's spread has no symmetric interval: the guard band is its farther end.
        spread = max(abs(high - part[f"{told}_mm"]), abs(part[f"{told}_mm"] - low)) / 2000.0
        yield CertifiedValue(
            name, value, "m", spread, 2.0, f"{part['count']} visits; {remark}", ("arm",)
        )
