"""A certified artefact on paper."""

from __future__ import annotations

from suta_calib.certificate.answer import CertifiedAnswer, Record, not_stated, quantities
from suta_calib.certificate.content import CertifiedValue, Content, ValueTable
from suta_calib.certificate.poses import AXES
from suta_calib.trust.uncertainty_budget import Contribution, UncertaintyBudget
from suta_calib.units import from_mm, key


class ArtefactOnPaper(CertifiedAnswer):
    """What ``certify`` wrote."""

    name = "certify"
    mark = "landmarks"

    def content(self, record: Record) -> Content:
        """Coordinates of every landmark, and the spacers that were measured as a check."""
        noise = record["noise"]
        factor = float(noise["coverage_factor"])
        groups = []
        for name, mark in record["landmarks"].items():
            rows = quantities(AXES, mark["position_mm"], mark["std_mm"], "m", factor)
            groups.append(ValueTable(f"Landmark {name}", tuple(rows)))
        largest = max(
            (float(std) for mark in record["landmarks"].values() for std in mark["std_mm"]),
            default=0.0,
        )
        touches = Contribution(
            "scatter of the touches, through the fit of planes and holes",
            "A",
            from_mm(largest),
            float(noise["degrees_of_freedom"]),
        )
        spacers = tuple(
            CertifiedValue(
                f"spacer {spacer['name']}",
                from_mm(float(spacer["length_mm"])),
                "m",
                from_mm(float(spacer["std_mm"])),
                factor,
                rests_on=("instrument",),
            )
            for spacer in record.get("spacers") or ()
        )
        return Content(
            title="Certification of an artefact",
            measurand="Coordinates of the landmarks in the frame of the artefact.",
            method=(
                f"{record['points']} points touched with one instrument. "
                f"{record['frame']['definition']}"
            ),
            groups=(*groups, *([ValueTable("Spacers", spacers)] if spacers else [])),
            budgets=(
                UncertaintyBudget("the least certain coordinate of a landmark", "m", (touches,)),
            ),
            checked=(
                ("flatness of the ground", f"{record['ground']['flatness_mm']:.4f} mm"),
                ("one touched coordinate, standard deviation", f"{noise['sigma_mm']:.4f} mm"),
            ),
            judged={key(row.name, "m"): row for row in spacers},
            references=(
                not_stated("instrument", "scale of the instrument that touched the points"),
            ),
            notes=tuple(record["verdict"]["notes"]),
        )
