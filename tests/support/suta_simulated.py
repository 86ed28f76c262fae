"""The shipped SUTA simulation with other errors put in, as terms, without files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from simulated import dh_parameters

from suta_calib.measurements import Artefact, Samples, read_artefact
from suta_calib.model.arm import ArmModel
from suta_calib.model.parameters import ParameterSet, Selection
from suta_calib.simulation import read_simulation, simulate
from suta_calib.terms import ArmPoses, FixedPoint, Noise, PairwiseDistance, Term
from suta_calib.trust.accuracy import BlockErrors, TermAccuracy
from suta_calib.trust.cross_validation import limited_rms

SUTA = Path(__file__).resolve().parents[2] / "data" / "suta"
HUBER = 1.35e-3
# What the choice of thirteen unknowns leaves out of the shipped simulation.
BENT = (
    '  - {select: ["joint_?.r[xy]"], std_deg: 0.1}\n',
    '  - {select: ["joint_?.[xy]"], std_mm: 1.2}\n',
)


@dataclass(frozen=True, eq=False)
class Scene:
    """Simulated measurements, and the truth."""

    arm: ArmModel
    truth: dict[str, float]
    artefact: Artefact
    samples: dict[str, Samples]

    def term(self, name: str) -> Term:
        """The set of that name as it is used in the shipped jobs."""
        poses, noise = ArmPoses(self.arm, self.samples[name]), Noise(huber=HUBER)
        if name == "fixed_point":
            return FixedPoint(poses, noise)
        return PairwiseDistance(poses, self.artefact, noise)

    def floor(self) -> float:
        """RMS of the validation distances with the true arm, m."""
        term = self.term("validation")
        _, p = self.arm.forward(term.poses.samples.q, self.truth)
        block = term.blocks[0]
        i, j = block.samples.T
        off = np.linalg.norm(p[i] - p[j], axis=1)[:, None] - block.data
        errors = BlockErrors("distance", "m", block.labels, block.samples, off, off)
        return limited_rms([TermAccuracy(term, (errors,))])


@cache
def scene(seed: int, errors: str = "", *, bent: bool = False) -> Scene:
    """Simulate the shipped description with another seed and further rows of errors.

    Args:
        seed: of everything random.
        errors: rows of the simulation's ``errors``, a line each.
        bent: whether the joints are out of square, which thirteen unknowns cannot tell.
    """
    text = (SUTA / "simulation.yaml").read_text()
    text = text.replace("../../urdf", str(SUTA.parents[1] / "urdf"))
    text = text.replace("artefact.yaml", str(SUTA / "artefact.yaml"))
    for row in BENT if not bent else ():
        assert row in text
        text = text.replace(row, "")
    rows = "".join(f"  - {row}\n" for row in filter(None, errors.split("\n")))
    text = text.replace("\nnoise:", f"{rows}\nnoise:", 1)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "simulation.yaml"
        file.write_text(text)
        made = simulate(read_simulation(file), seed)
    samples: dict[str, list[Samples]] = {}
    for each in made.files:
        samples.setdefault(each.path.split("/")[0], []).append(each.samples)
    joined = {name: Samples.concatenate(parts) for name, parts in samples.items()}
    return Scene(made.arm, made.values, read_artefact(SUTA / "artefact.yaml"), joined)


def thirteen(arm: ArmModel) -> ParameterSet:
    """Six offsets and seven lengths."""
    return dh_parameters(arm)


def everything(arm: ArmModel) -> ParameterSet:
    """All of the geometry."""
    return arm.select(
        Selection(("geometric",), bound_m=0.03, bound_rad=0.26),
        Selection(("*.offset",), bound_rad=0.26),
    )
