"""Make the simulated files of this folder again: ``python -m data.thesis.make``, fixed seeds.

The measurements of chapter 3 as `simulation.yaml` describes them, in ``simulated/``; appendix E's
four tests of repeatability, appendix D's touches of a laser tracker, and the certificate in which
S2 stands aside, as in appendix F.3.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from data.artefact.probed_artefact import ProbingPattern, Row, csv_text, exact_rows
from suta_calib import ArmModel, simulate
from suta_calib.arrays import FloatArray
from suta_calib.measurements import (
    Artefact,
    Landmark,
    Samples,
    read_artefact,
    write_artefact,
    write_samples,
    write_text,
)
from suta_calib.simulation import (
    InverseKinematics,
    Targets,
    read_simulation,
    write_simulation,
)

FOLDER = Path(__file__).resolve().parent
DRAWING = read_artefact(FOLDER / "artefact.yaml")
# Appendix D: the workshop's error in space, RMS; the tracker's; what was bent on purpose.
MADE, TRACKER, DAMAGED = 0.19e-3, 1e-6, "L1"
# Appendix E, degrees per joint: at rest; between visits without force and pushed south. The text
# has joints 1 and 3 and the mean of all; the others are chosen so that these come out.
AT_REST = [0.00004, 0.00006, 0.00008, 0.00010, 0.00012, 0.00013]
FREE = [0.145, 0.070, 0.020, 0.075, 0.090, 0.110]
# Test C: what 5 N make of each joint, degrees, pushed north, east and down; back the other way.
NORTH = [0.02, 0.10, 0.10, -0.20, 0.40, -1.45]
EAST = [0.095, 0.02, -0.15, 0.10, -0.60, 0.20]
DOWN = [0.01, -0.12, 0.02, 0.15, 0.02, 0.05]
STEP = 2 * np.pi / 2**22


def main() -> None:
    """Write all files."""
    write_simulation(simulate(read_simulation(FOLDER / "simulation.yaml")), FOLDER / "simulated")
    repeatability()
    certification()
    shift = 2e-3 * np.array([0.6, -0.64, 0.48])
    wrong = {
        name: replace(mark, position=mark.position + shift) if name == "S2" else mark
        for name, mark in DRAWING.landmarks.items()
    }
    write_artefact(FOLDER / "artefact_s2.yaml", Artefact("S2 stands aside by 2 mm", wrong))


def repeatability() -> None:
    """Landmark O at the standard position: at rest, thirty visits, pushes, thirty pushed visits."""
    arm = ArmModel.from_urdf(FOLDER / "../../urdf/suta.urdf", "tip")
    mark = DRAWING.landmarks["O"]
    posture = np.radians([15.0, 175.0, 160.0, 110.0, -90.0, -125.0])
    target = Targets(mark.position[None] + [0.5125, 0.0125, 0.0], mark.rotation[None], "pose")
    seat = InverseKinematics(arm, {}).solve(target, posture, np.random.default_rng(0)).q[0]
    random = np.random.default_rng(5)
    rest = seat + np.radians(AT_REST) * random.standard_normal((600, 6))
    rows = [f"{k / 5:.1f}," + ",".join(f"{v:.9f}" for v in q) for k, q in enumerate(counted(rest))]
    text = "\n".join([",".join(["time", *arm.joints]), *rows]) + "\n"
    write_text(FOLDER / "test_a_stationary.csv", text)
    free = seat + scattered(random, FREE, sized(arm, seat, 0.95e-3))
    pushed = seat + scattered(random, FREE, sized(arm, seat, 0.45e-3))
    labels = ["free"] * 30 + ["south"] * 30
    visits = Samples.from_arrays(
        arm.joints, counted(np.vstack([free, pushed])).round(9), labels={"protocol": labels}
    )
    write_samples(FOLDER / "test_b_and_d_visits.csv", visits)
    pushes = {"north": NORTH, "south": NORTH, "east": EAST, "west": EAST, "down": DOWN}
    sign = {"south": -1.0, "west": -1.0}
    direction = [list(pushes)[k % 5] for k in range(30)]
    q = seat + np.radians([np.multiply(sign.get(d, 1.0), pushes[d]) for d in direction])
    q = q + np.radians(0.02) * random.standard_normal((30, 6))
    labelled = Samples.from_arrays(
        arm.joints, counted(q).round(9), labels={"direction": direction, "force_n": ["5"] * 30}
    )
    write_samples(FOLDER / "test_c_pushes.csv", labelled)


def sized(arm: ArmModel, seat: FloatArray, rms: float) -> tuple[FloatArray, float]:
    """Of the tip: its (3, 6) Jacobian at a posture, and how far it shall scatter in space, m."""
    step = 1e-6
    tip = arm.forward(seat + step * np.vstack([np.eye(6), -np.eye(6)]))[1]
    return (tip[:6] - tip[6:]).T / (2 * step), rms


def scattered(
    random: np.random.Generator, std: list[float], size: tuple[FloatArray, float]
) -> FloatArray:
    """Thirty deviations (30, 6), rad, of these proportions by joint, of that size at the tip.

    A seat holds the tip, so the joints move together: what the draw moves the tip too far or not
    far enough is taken up by the joints in proportion to their own scatter.
    """
    jacobian, rms = size
    wanted = np.radians(std)
    q = wanted * random.standard_normal((30, 6))
    tip = (q - q.mean(axis=0)) @ jacobian.T
    share = rms / np.sqrt(np.mean(np.sum(tip**2, axis=1)))
    # The least motion of the joints, weighed by their scatter, that takes the tip where it shall.
    weighed = jacobian * wanted**2
    correction = (share - 1.0) * tip @ np.linalg.solve(weighed @ jacobian.T, weighed)
    return np.asarray(q - q.mean(axis=0) + correction)


def counted(q: FloatArray) -> FloatArray:
    """As 22-bit encoders read it."""
    return np.asarray(np.angle(np.exp(1j * STEP * np.round(q / STEP))))


def certification() -> None:
    """Ten touches of the ground over 250 mm, five of each top, four holes, two flats, spacers."""
    random = np.random.default_rng(6)
    made = {
        name: Landmark(
            name, mark.position + MADE / np.sqrt(3) * random.standard_normal(3), mark.rotation
        )
        for name, mark in DRAWING.landmarks.items()
    }
    datum = made["O"].position * [1, 1, 0]
    made = {n: replace(m, position=m.position - datum) for n, m in made.items()}
    spacers = {str(k + 1): 0.110 + 1e-5 * random.standard_normal() for k in range(4)}
    rows = exact_rows(Artefact("as made", made), ProbingPattern(spacers=spacers))
    grid = [(x, y) for y in (-0.12, 0.12) for x in np.linspace(-0.125, 0.125, 5)]
    ground: list[Row] = [("ground", "", k, np.array([*xy, 0.0])) for k, xy in enumerate(grid)]
    bent = np.array([0.9e-3, -0.5e-3, 0.0])
    kept = [
        (feature, name, k, point + bent * (name == DAMAGED))
        for feature, name, k, point in rows
        if feature != "ground"
    ]
    note = "simulated raw points of an artefact; no instrument was there"
    text = csv_text([*ground, *kept], TRACKER, np.random.default_rng(7), note)
    write_text(FOLDER / "certification.csv", text)


if __name__ == "__main__":
    main()
