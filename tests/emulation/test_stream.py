from __future__ import annotations

import itertools
import math
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from emulated import angles, decoded, device_of

from suta_calib.arrays import FloatArray
from suta_calib.device.description import DeviceSpec
from suta_calib.emulation import Emulation, Faults, Still, Sweep, frames
from suta_calib.emulation.faults import WORDS, Flag, Gap, Window
from suta_calib.emulation.stream import STALE_AFTER, STALE_TURN
from suta_calib.errors import InputError
from suta_calib.geometry.numbers import wrap
from suta_calib.model.arm import ArmModel

POSTURE = np.array([0.3, -1.0, 3.1, -3.1, 2.0, 0.0])
STEP = 2 * np.pi / 2**22


@pytest.fixture(scope="module")
def device(arm: ArmModel) -> DeviceSpec:
    return device_of(arm, signs=[1, -1, 1, -1, 1, -1])


@pytest.fixture
def moving(device: DeviceSpec) -> Emulation:
    return Emulation(device, Sweep(POSTURE, np.full(6, 0.4), 0.2, 1.0, 5.0), seed=4)


def faulty(device: DeviceSpec, text: str, rate: float = 500.0) -> Emulation:
    return Emulation(device, Still(POSTURE), rate, faults=Faults.parse(text), seed=7)


def sent(emulation: Emulation, seconds: float) -> np.ndarray:
    """(n, 3) when each frame was sent, its sequence number and its clock as on the wire, s."""
    rows = [(due, *struct.unpack_from("<HI", data, 2)) for due, data in frames(emulation, seconds)]
    return np.array(rows) * [1, 1, 1e-6]


# ── Undamaged ────────────────────────────────────────────────────────────────────────────────
def test_the_same_seed_gives_the_same_bytes(moving: Emulation) -> None:
    one, again, other = (
        list(frames(emulation, 0.5)) for emulation in (moving, moving, replace(moving, seed=5))
    )
    assert one == again
    assert [data for _, data in one] != [data for _, data in other]
    assert len(one) == 384


def test_time_stamps_are_exact_and_nothing_is_missing(moving: Emulation) -> None:
    readings, statistics = decoded(moving, 2.0)
    assert [each.sequence for each in readings] == list(range(1536))
    expected = [round(1e6 * k / 768) / 1e6 for k in range(1536)]
    np.testing.assert_allclose([each.time for each in readings], expected, rtol=0, atol=1e-9)
    assert statistics.garbage_bytes == statistics.lost_frames == 0


def test_sequence_and_clock_wrap(moving: Emulation) -> None:
    late = replace(moving, first_sequence=2**16 - 100, first_time_us=2**32 - 100_000)
    readings, statistics = decoded(late, 1.0)
    assert statistics.lost_frames == 0
    assert {each.sequence - k for k, each in enumerate(readings)} == {2**16 - 100}
    steps = np.diff([each.time for each in readings])
    np.testing.assert_allclose(steps, 1 / 768, atol=2e-6)


def errors(emulation: Emulation, seconds: float) -> FloatArray:
    """(n, joints) of what is read, rad."""
    readings, _ = decoded(emulation, seconds)
    return wrap(
        angles(readings) - emulation.motion.readings(np.arange(len(readings)) / emulation.rate)
    )


def test_readings_are_true_ones_with_noise_in_whole_counts(moving: Emulation) -> None:
    noisy = replace(moving, noise=1e-4)
    error = errors(noisy, 4.0)
    np.testing.assert_allclose(error.std(axis=0), 1e-4, rtol=0.06)
    np.testing.assert_allclose(error.mean(axis=0), 0, atol=5 * 1e-4 / math.sqrt(len(error)))
    counts = angles(decoded(noisy, 1.0)[0]) / STEP
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert 0.4 * STEP < np.abs(errors(replace(moving, noise=0.0), 0.2)).max() <= 0.5000001 * STEP


def test_each_joint_may_have_noise_of_its_own(moving: Emulation) -> None:
    error = errors(replace(moving, noise=np.array([0, 1e-3, 0, 0, 0, 0])), 1.0)
    assert error.std(axis=0)[1] == pytest.approx(1e-3, rel=0.1)
    assert np.delete(error.std(axis=0), 1).max() < STEP


@pytest.mark.parametrize("unit", ["counts", "rad", "deg"])
def test_lines(arm: ArmModel, unit: str) -> None:
    turn = 8192
    device = device_of(arm, form="lines", unit=unit, counts_per_turn=turn, signs=[-1] * 6)
    emulation = Emulation(device, Still(POSTURE), 100.0, noise=0.0)
    readings, _ = decoded(emulation, 0.5)
    assert len(readings) == 49, "the first line may be the end of one"
    step = 2 * np.pi / turn if unit == "counts" else 1e-5
    assert np.abs(wrap(angles(readings) - POSTURE)).max() <= step / 2


def test_an_encoder_of_22_bits_has_no_other_counts(arm: ArmModel) -> None:
    with pytest.raises(InputError, match="4194304"):
        device_of(arm, counts_per_turn=4096)
    with pytest.raises(InputError, match="2 signs"):
        device_of(arm, signs=[1, -1])


def test_a_sliding_joint_has_no_angle(tmp_path: Path) -> None:
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(
        '<robot name="r"><link name="a"/><link name="b"/>\n<joint name="j" type="prismatic">'
        '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    slide = ArmModel.from_urdf(urdf, "b")
    with pytest.raises(InputError, match=r"slide\.urdf:2: found prismatic joint 'j'"):
        device_of(slide)
    metres = device_of(slide, form="lines", unit="rad")
    readings, _ = decoded(Emulation(metres, Still(np.array([0.25])), noise=0.0), 0.1)
    assert angles(readings)[-1] == pytest.approx(0.25, abs=1e-6)


def test_what_does_not_fit_together_is_refused(device: DeviceSpec) -> None:
    with pytest.raises(InputError, match="2 joints"):
        Emulation(device, Still(np.zeros(2)))
    with pytest.raises(InputError, match="rate"):
        Emulation(device, Still(np.zeros(6)), rate=0.0)
    with pytest.raises(InputError, match=r"no joint 'joint_9'.*joint_6"):
        Emulation(device, Still(np.zeros(6)), faults=Faults.parse("error=joint_9:1@0"))


# ── Faults ───────────────────────────────────────────────────────────────────────────────────
@pytest.mark.parametrize("name", ["corrupt", "flip"])
def test_so_many_bytes_are_damaged(device: DeviceSpec, name: str) -> None:
    clean, dirty = (
        b"".join(data for _, data in frames(faulty(device, text), 6.0))
        for text in ("", f"{name}=0.01")
    )
    changed = np.frombuffer(clean, np.uint8) ^ np.frombuffer(dirty, np.uint8)
    hit = changed[changed != 0]
    assert len(hit) / len(changed) == pytest.approx(0.01, rel=0.1)
    bits = np.unpackbits(hit[:, None], axis=1).sum(axis=1)
    assert (bits == 1).all() if name == "flip" else 3.8 < bits.mean() < 4.2
    _, statistics = decoded(faulty(device, f"{name}=0.01"), 2.0)
    assert 550 < statistics.frames < 800, "0.99^35 of 1000 frames are whole"


def test_lost_bytes_and_skipped_frames(device: DeviceSpec) -> None:
    clean = sum(len(data) for _, data in frames(faulty(device, ""), 6.0))
    dirty = sum(len(data) for _, data in frames(faulty(device, "lose=0.02"), 6.0))
    assert 1 - dirty / clean == pytest.approx(0.02, rel=0.1)
    _, statistics = decoded(faulty(device, "skip=0.1"), 6.0)
    assert statistics.lost_frames / 3000 == pytest.approx(0.1, rel=0.2)
    assert statistics.garbage_bytes == 0


@pytest.mark.parametrize(
    ("text", "silent"),
    [
        ("gap=5@0.1,stall=0.2@0.3", [*range(50, 55), *range(150, 250)]),
        ("disconnect=0.2@0.3", [*range(150, 250)]),
    ],
)
def test_silences_are_not_made_up_for(device: DeviceSpec, text: str, silent: list[int]) -> None:
    row = sent(faulty(device, text), 1.0)
    np.testing.assert_array_equal(row[:, 0], row[:, 1] / 500)
    assert sorted(set(range(500)) - set(row[:, 1].astype(int))) == silent


def test_frames_held_back_come_all_at_once_and_in_order(device: DeviceSpec) -> None:
    row = sent(faulty(device, "hold=0.2@0.3"), 1.0)
    np.testing.assert_array_equal(row[:, 1], np.arange(500))
    assert (np.diff(row[:, 0]) >= 0).all()
    assert np.count_nonzero(np.isclose(row[:, 0], 0.5)) == 101
    assert not ((row[:, 0] >= 0.3) & (row[:, 0] < 0.4999)).any()


def test_a_burst_of_garbage_hides_frames(device: DeviceSpec) -> None:
    clean, dirty = (dict(frames(faulty(device, text), 1.0)) for text in ("", "burst=0.1@0.4"))
    damaged = [due for due in clean if clean[due] != dirty[due]]
    assert (min(damaged), len(damaged)) == (0.4, 50)
    assert all(len(clean[due]) == len(dirty[due]) for due in damaged)
    readings, statistics = decoded(faulty(device, "burst=0.1@0.4"), 1.0)
    assert len(readings) == 450
    assert statistics.lost_frames == 50


def test_a_cache_gives_old_frames_of_another_posture_first(device: DeviceSpec) -> None:
    emulation = replace(faulty(device, "stale=10"), first_time_us=60_000_000, noise=0.0)
    (due, cached), *rest = frames(emulation, 0.1)
    assert due == pytest.approx(STALE_AFTER, abs=2e-3)
    size = len(rest[0][1])
    assert len(cached) == 10 * size
    clocks = [struct.unpack_from("<I", cached, k * size + 4)[0] for k in range(10)]
    assert clocks == [55_000_000 + 2000 * k for k in range(10)]
    assert struct.unpack_from("<I", rest[0][1], 4)[0] == 60_000_000 + round(1e6 * (due + 0.002))
    readings, _ = decoded(emulation, 0.1)
    old = wrap(angles(readings[:10]) - POSTURE)
    np.testing.assert_allclose(old, STALE_TURN, atol=STEP)


def test_a_reboot_starts_sequence_and_clock_anew(device: DeviceSpec) -> None:
    emulation = replace(faulty(device, "reboot=0.2@0.3"), first_sequence=900, first_time_us=7000)
    row = sent(emulation, 1.0)
    before, after = row[row[:, 0] < 0.3], row[row[:, 0] >= 0.3]
    np.testing.assert_array_equal(before[:, 1], np.arange(900, 1050))
    np.testing.assert_array_equal(after[:, 1], np.arange(250))
    np.testing.assert_allclose(after[:, 2], np.arange(250) / 500)
    assert after[0, 0] == 0.5


def test_flags_are_raised_by_joint_and_time(device: DeviceSpec) -> None:
    emulation = faulty(device, "error=joint_3:0.1@0.2,warning=joint_5:0.2@0.25")
    readings, _ = decoded(emulation, 1.0)
    error = np.array([each.error for each in readings])
    warning = np.array([each.warning for each in readings])
    time = np.arange(500) / 500
    np.testing.assert_array_equal(error[:, 2], (time >= 0.2) & (time < 0.3))
    np.testing.assert_array_equal(warning[:, 4], (time >= 0.25) & (time < 0.45))
    assert not np.delete(error, 2, axis=1).any()
    assert not np.delete(warning, 4, axis=1).any()


# ── Their notation ───────────────────────────────────────────────────────────────────────────
def test_faults_are_written_in_one_line() -> None:
    found = Faults.parse(
        " corrupt=0.01, flip=1e-3,lose=0.5,skip=0,stale=10,gap=3@2.5,burst=2@5,stall=2@10,hold=1@0,"
        "disconnect=3@15,reboot=1@20,stall=1@30,error=joint_3:0.5@7,warning=a:b:1@8,"
    )
    assert found == Faults(
        *(0.01, 1e-3, 0.5, 0.0, 10, (Gap(3, 2.5),), (Window(5, 2),)),
        *((Window(10, 2), Window(30, 1)), (Window(0, 1),), (Window(15, 3),), (Window(20, 1),)),
        *((Flag("joint_3", Window(7, 0.5)),), (Flag("a:b", Window(8, 1)),)),
    )
    assert found.absences == (Window(15, 3), Window(20, 1))
    assert Faults.parse("") == Faults()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("corupt=0.1", r"'corupt=0.1'.*corrupt"),
        ("corrupt", r"'corrupt'.*corrupt=SHARE"),
        ("corrupt=1.5", "from 0 to 1"),
        ("lose=-0.1", "not negative"),
        ("flip=nan", "not negative"),
        ("stall=2", r"stall=S@T"),
        ("stall=x@2", r"stall=S@T"),
        ("burst=inf@2", "not negative"),
        ("stale=1.5", "stale=N"),
        ("gap=0.5@2", "gap=N@T"),
        ("error=joint_1@2", r"error=JOINT:S@T"),
        ("disconnect=5@1,reboot=1@3", "do not overlap"),
        ("5", "one of"),
    ],
)
def test_faults_that_mean_nothing_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Faults.parse(text)


def test_every_word_of_the_help_can_be_parsed() -> None:
    examples = {"SHARE": "0.5", "N@T": "2@1", "S@T": "0.5@1", "N": "3", "JOINT:S@T": "j:0.5@1"}
    examples |= {"MM:S@T": "3:0.5@1", "MM@T": "2@1"}
    for word in WORDS:
        name, _, form = word.partition("=")
        assert Faults.parse(f"{name}={examples[form]}") != Faults(), word


def test_an_endless_stream_is_not_computed_ahead(moving: Emulation) -> None:
    assert len(list(itertools.islice(frames(moving), 100))) == 100
