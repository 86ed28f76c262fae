"""An emulated arm that is swept by hand keeps its tip where it shall be."""

from __future__ import annotations

import numpy as np
import pytest
from device_stand_in import POSTURE
from hand_sweeps import hand_motion, suta

from suta_calib.emulation import EmulationOptions, Faults, HandSweep, emulated_device, swept_by_hand
from suta_calib.emulation.truth import drawn_truth
from suta_calib.errors import InputError, JobError
from suta_calib.geometry.numbers import rotation_from_rpy

TIME = np.arange(0.0, 24.0, 0.013)


def tips(seed: int, **more: object) -> tuple[np.ndarray, np.ndarray]:
    motion = hand_motion(seed, **more)  # type: ignore[arg-type]
    return suta().forward(motion.readings(TIME), drawn_truth(suta(), seed))


def test_a_tip_in_a_socket_stays_there_while_the_tool_is_tilted() -> None:
    rotation, position = tips(1, seat=0.0)
    assert np.linalg.norm(position - position[0], axis=1).max() < 2e-6
    tilt = np.degrees(np.arccos(np.clip(rotation[:, :, 2] @ rotation[0, :, 2], -1, 1)))
    assert 15.0 < tilt.max() < 30.0
    # It moves all the time, and no posture comes back.
    q = hand_motion(1, seat=0.0).readings(np.arange(1.0, 23.0, 0.25))
    away = np.abs(q[:, None] - q).max(axis=2) + np.eye(len(q))
    assert np.degrees(away[np.triu_indices(len(q), 1)].min()) > 0.2


def test_a_tip_on_a_plate_stays_on_its_plane() -> None:
    upright = rotation_from_rpy([0.2, -0.1, 0.0])
    values = drawn_truth(suta(), 5)
    how = HandSweep(0.4, 0.1, 24.0)
    motion = swept_by_hand(suta(), values, how, posture=POSTURE, upright=upright, seed=5)
    position = suta().forward(motion.readings(TIME), values)[1] @ upright
    assert np.ptp(position[:, 2]) < 5e-6
    assert np.all(np.ptp(position[:, :2], axis=0) > 0.05)


def test_the_tip_lifts_off_and_its_place_slips_when_it_shall() -> None:
    rotation, position = tips(3, faults="lift=4:0.5@5,slip=2@12", seat=0.0)
    away = position - position[0]
    before, off, after = TIME < 4.9, (TIME > 5.2) & (TIME < 5.4), TIME > 12.2
    assert np.linalg.norm(away[before], axis=1).max() < 2e-6
    np.testing.assert_allclose(away[off], -4e-3 * rotation[off][:, :, 2], atol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(away[after], axis=1), 2e-3, atol=2e-6)
    assert np.linalg.norm(away[after] - away[-1], axis=1).max() < 4e-6


def test_the_seat_errs_by_as_much_as_is_said() -> None:
    _, position = tips(1, seat=1e-4)
    assert 0.5e-4 < (position - position.mean(axis=0)).std() < 1.6e-4


def test_what_the_arm_cannot_follow_is_refused() -> None:
    with pytest.raises(JobError, match="out of the arm's reach"):
        swept_by_hand(suta(), {}, HandSweep(2.5), posture=POSTURE)


@pytest.mark.parametrize("motion", [None, "pivot"])
def test_only_a_hand_lifts_a_tip(motion: str | None) -> None:
    options = EmulationOptions(
        suta().chain.path, "tip", motion=motion, faults=Faults.parse("lift=3:1@2")
    )  # type: ignore[arg-type]
    with pytest.raises(InputError, match="--motion socket or plate"):
        emulated_device(options)
