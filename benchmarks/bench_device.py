"""The wire: how fast it is decoded, what noise gets through, and streams held in real time.

    bench_device.py [--megabytes 10] [--seconds 5]

`make bench-device` asks for 100 million bytes of every kind of noise and for 60 s of every
stream. Fails where a figure misses its target.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from limits import BY_KEY, record
from rich.console import Console
from scipy.stats import poisson
from tables import number_table

from suta_calib.device import (
    Bus,
    DeviceSpec,
    JointSpec,
    Reading,
    angles_from_counts,
    decoder_for,
    encode_frame,
    encode_line,
    frame_crc,
)
from suta_calib.emulation import EmulatedArm, Emulation, Still

RATE = 768.0
FAST = 5000.0
CHUNK = 1 << 16
BLOCK = 20_000
# So unlikely a count would be an error, not bad luck.
LUCK = 1e-6


def device(count: int = 6, **changes: object) -> DeviceSpec:
    joints = tuple(JointSpec(f"joint_{k + 1}", 1) for k in range(count))
    given = {"path": Path("device.yaml"), "port": "", "baudrate": 921600, "format": "frames"}
    given |= {"unit": "counts", "counts_per_turn": 1 << 22, "joints": joints}
    return DeviceSpec(**(given | changes))  # type: ignore[arg-type]


# ── Throughput ──────────────────────────────────────────────────────────────────────────────
def throughput() -> float:
    """Print how many streams of 768 Hz one core decodes; the least of them."""
    random = np.random.default_rng(0)
    counts = random.integers(0, 1 << 22, (BLOCK, 6)).tolist()
    framed = device()
    lines = device(format="lines", counts_per_turn=1 << 22)
    cases = [
        ("frames", framed, [encode_frame(n, 1302 * n, row) for n, row in enumerate(counts)]),
        ("lines", lines, [encode_line(row, lines) for row in counts]),
    ]
    title = f"Decoding on one core, as multiples of {RATE:g} Hz of six joints"
    columns = ("format", "pieces of", "readings per s", "µs each", "multiple")
    table = number_table(title, *columns)
    least = np.inf
    for name, spec, packets in cases:
        data = b"".join(packets)
        for size in (1, len(packets[0]), 4096, CHUNK):
            share = data[: len(data) // 20] if size == 1 else data
            rate = decoding_rate(spec, share, size)
            shown = "one byte" if size == 1 else f"{size} bytes"
            row = (f"{rate:,.0f}", f"{1e6 / rate:.1f}", f"{rate / RATE:.0f}")
            table.add_row(name, shown, *row)
            least = min(least, rate / RATE) if size > 1 else least
    Console(width=100).print(table)
    return float(least)


def decoding_rate(spec: DeviceSpec, data: bytes, size: int) -> float:
    decoder, count = decoder_for(spec), 0
    began = time.process_time()
    for at in range(0, len(data), size):
        count += len(decoder.feed(data[at : at + size], 0.0))
    return count / (time.process_time() - began)


# ── Noise ───────────────────────────────────────────────────────────────────────────────────
@dataclass
class Noise:
    """One kind of noise through the decoder."""

    name: str
    bytes: int = 0
    readings: int = 0
    false: int = 0
    expected: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether there are no more false readings than the CRCs let through."""
        return self.false <= poisson.ppf(1 - LUCK, self.expected)


def random_bytes(size: int) -> Noise:
    """Nothing but noise."""
    noise, decoder, random = Noise("random bytes"), decoder_for(device()), np.random.default_rng(1)
    while noise.bytes < size:
        noise.false += len(decoder.feed(random.bytes(CHUNK), 0.0))
        noise.bytes += CHUNK
    noise.expected = noise.bytes * 2.0**-88
    return noise


def fake_frames(size: int, count: int, fitting: bool) -> Noise:
    """Frames with the right header and count, and noise in place of all the rest."""
    what = "right CRC-16, random words" if fitting else "right header, random rest"
    noise = Noise(f"{what}; {count} joint{'s' * (count > 1)}")
    decoder, random, length = decoder_for(device(count)), np.random.default_rng(2), 11 + 4 * count
    while noise.bytes < size:
        block = random.integers(0, 256, (CHUNK // length, length), dtype=np.uint8)
        block[:, 0], block[:, 1], block[:, 8] = 0xAA, 0x55, count
        if fitting:
            crc = [frame_crc()(row[2:-2].tobytes()) for row in block]
            block[:, -2:] = np.array(crc, dtype="<u2").view(np.uint8).reshape(-1, 2)
        noise.false += len(decoder.feed(block.tobytes(), 0.0))
        noise.bytes += block.size
        # A word passes by its CRC-6 and its two spare bits, a frame by its CRC-16.
        noise.expected += len(block) * 2.0 ** (-8 * count - 16 * (not fitting))
    return noise


def corrupted_frames(size: int, share: float, flips: bool) -> Noise:
    """True frames with a share of their bytes replaced, or with one bit of them wrong."""
    what = "one bit of" if flips else "replaced:"
    noise, spec = Noise(f"frames, {what} {share:.0%} of bytes"), device()
    random, decoder = np.random.default_rng(3), decoder_for(spec)
    counts = random.integers(0, 1 << 22, (BLOCK, 6))
    # Of a clock that runs: its sum over all of them must stay exact to 1 µs in a float.
    times = np.arange(BLOCK) * round(1e6 / RATE) + 123_456_789
    frames = [encode_frame(n, int(times[n]), counts[n].tolist()) for n in range(BLOCK)]
    clean = np.frombuffer(b"".join(frames), dtype=np.uint8).reshape(BLOCK, -1)
    angles = angles_from_counts(counts, np.ones(6, dtype=np.int64), 1 << 22)
    while noise.bytes < size:
        hit = random.random(clean.shape) < share
        change = random.integers(1, 256, clean.shape, dtype=np.uint8)
        if flips:
            change = np.uint8(1) << (change & 7)
        data = (clean ^ np.where(hit, change, 0).astype(np.uint8)).tobytes()
        for at in range(0, len(data), CHUNK):
            readings = decoder.feed(data[at : at + CHUNK], 0.0)
            noise.readings += len(readings)
            noise.false += count_false(readings, times, angles)
        noise.bytes += len(data)
        noise.expected += expected_through(hit)
    return noise


def count_false(readings: list[Reading], times: np.ndarray, angles: np.ndarray) -> int:
    """Readings that are not what was sent under their number."""
    if not readings:
        return 0
    number = np.array([r.sequence for r in readings]) % (1 << 16)
    known = number < BLOCK
    number[~known] = 0
    clock = np.rint(np.array([r.time for r in readings]) * 1e6).astype(np.int64) % (1 << 32)
    told = np.array([r.angles for r in readings])
    return int((~known | (clock != times[number]) | (told != angles[number]).any(axis=1)).sum())


def expected_through(hit: np.ndarray) -> float:
    """How many damaged frames fit their CRCs all the same.

    The CRC-16 sees every error within one byte; a frame with more passes in 1 of 65,536 cases,
    and each damaged word in 1 of 256.
    """
    words = hit[:, 9:33].reshape(len(hit), -1, 4).any(axis=2).sum(axis=1)
    frames = (hit.sum(axis=1) > 1) & ~hit[:, :2].any(axis=1) & ~hit[:, 8]
    return float((frames * 2.0 ** (-16 - 8 * words)).sum())


def noises(size: int) -> list[Noise]:
    found = [
        random_bytes(size),
        fake_frames(size, 6, fitting=False),
        fake_frames(size, 1, fitting=False),
        fake_frames(size // 10, 1, fitting=True),
        corrupted_frames(size, 0.01, flips=False),
        corrupted_frames(size, 0.01, flips=True),
        corrupted_frames(size, 0.10, flips=False),
    ]
    columns = ("kind", "bytes", "true readings", "false", "CRCs let through")
    table = number_table("Noise through the decoder: no exception, and", *columns)
    for each in found:
        true = f"{each.readings - each.false:,}" if each.readings else "–"
        row = (f"{each.bytes:,}", true, f"{each.false:,}", f"{each.expected:.3g}")
        table.add_row(each.name, *row)
    Console(width=100).print(table)
    return found


# ── Real time ───────────────────────────────────────────────────────────────────────────────
@dataclass
class Held:
    """A stream over a pty, for some time."""

    rate: float
    seconds: float
    frames: int
    lost: int
    damaged: int
    core: float


def hold(rate: float, seconds: float) -> Held:
    """Read an emulated arm that streams from another process."""
    emulation = Emulation(device(), Still(np.zeros(6)), rate=rate)
    with EmulatedArm(emulation) as arm, Bus(arm.device) as bus:
        while not bus.read():
            pass
        counts = bus.statistics
        first, began, busy = counts.frames, time.perf_counter(), time.process_time()
        while time.perf_counter() < began + seconds:
            bus.read()
        passed, busy = time.perf_counter() - began, time.process_time() - busy
        damaged = counts.frame_crc_errors + counts.word_crc_errors + counts.garbage_bytes
        frames = counts.frames - first
        return Held(rate, passed, frames, counts.lost_frames, damaged, busy / passed)


def streams(seconds: float) -> list[Held]:
    found = [hold(rate, seconds) for rate in (RATE, FAST)]
    title = "Six joints over a pty, from an emulated arm in another process"
    table = number_table(title, "Hz", "s", "frames", "lost", "damaged", "of a core")
    for each in found:
        row = (f"{each.frames:,}", str(each.lost), str(each.damaged), f"{each.core:.0%}")
        table.add_row(f"{each.rate:g}", f"{each.seconds:.1f}", *row)
    Console(width=100).print(table)
    return found


def main() -> None:
    """Print the tables, and fail where a figure misses its target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=float, default=10.0, help="of every kind of noise")
    parser.add_argument("--seconds", type=float, default=5.0, help="of every stream")
    options = parser.parse_args()
    missed = []
    limit, multiple = BY_KEY["bulk"], throughput()
    record(limit.key, [multiple])
    if not limit.kept(multiple):
        missed.append(f"decoding at {multiple:.1f} times {RATE:g} Hz is below {limit.bound:g}")
    missed += [
        f"{each.name}: {each.false} false readings, {each.expected:.3g} expected"
        for each in noises(round(1e6 * options.megabytes))
        if not each.passed
    ]
    for each in streams(options.seconds):
        if each.lost or each.damaged or each.frames < 0.98 * each.rate * each.seconds:
            missed.append(f"{each.rate:g} Hz: {each}")
        if each.core > 0.5:
            missed.append(f"{each.rate:g} Hz takes {each.core:.0%} of a core, more than half")
    if missed:
        raise SystemExit("\n".join(missed))


if __name__ == "__main__":
    main()
