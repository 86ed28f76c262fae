"""Counters of few bits, as a device sends them, unwrapped to numbers that only grow."""

from __future__ import annotations

from typing import Final

_SEQUENCES: Final = 1 << 16
_CLOCK: Final = 1 << 32
_MICRO: Final = 1e-6
# A pause has to be this long before its wraps are counted: no device sends 65,536 frames in it.
_LONG_PAUSE_S: Final = 1.0
_ENOUGH_FRAMES: Final = 100


class DeviceClock:
    """Unwraps the frames' u16 sequence number and u32 time in µs.

    Both wrap: at 768 Hz after 85 s and after 72 minutes. A pause may hide whole turns of a
    counter: those of the clock are found from the time of arrival, those of the sequence number
    from the clock and the rate so far.
    """

    def __init__(self) -> None:
        self._anchor: tuple[int, float, float] | None = None
        self._reset()

    def _reset(self) -> None:
        self._started = False
        self._raw_sequence = self._raw_time = 0
        self._sequence = self._microseconds = 0
        self._arrival = 0.0
        self._frames = self._steps = self._span = 0
        self._shift = 0.0  # s, from the clock as sent to the time given out

    def unwrap(self, sequence: int, time_us: int, arrival: float) -> tuple[int, float, int]:
        """Take the counters of the next frame.

        Args:
            sequence: u16.
            time_us: u32, µs.
            arrival: when it came, s.

        Returns:
            Unwrapped sequence number, unwrapped time in s, and how many frames are missing
            between the last one and this one.
        """
        if not self._started:
            lost = 0
            self._start(sequence, time_us, arrival)
        else:
            lost = self._advance(sequence, time_us, arrival)
        self._raw_sequence, self._raw_time, self._arrival = sequence, time_us, arrival
        return self._sequence, self._microseconds * _MICRO + self._shift, lost

    def resume(self, sequence: int, time: float, arrival: float) -> None:
        """Go on from a reading of before, by arrival, whatever the next frame's counters say."""
        self._reset()
        self._anchor = (sequence, time, arrival)

    def _start(self, sequence: int, time_us: int, arrival: float) -> None:
        self._started = True
        self._sequence, self._microseconds = sequence, time_us
        if self._anchor is not None:
            last_sequence, last_time, last_arrival = self._anchor
            self._sequence = last_sequence + 1
            now = last_time + max(arrival - last_arrival, 0.0)
            self._shift = now - time_us * _MICRO

    def _advance(self, sequence: int, time_us: int, arrival: float) -> int:
        elapsed = (time_us - self._raw_time) % _CLOCK
        # Never fewer than none: what comes in one piece has one time of arrival.
        elapsed += _CLOCK * max(0, round(((arrival - self._arrival) / _MICRO - elapsed) / _CLOCK))
        step = (sequence - self._raw_sequence) % _SEQUENCES
        if elapsed * _MICRO > _LONG_PAUSE_S and self._frames >= _ENOUGH_FRAMES:
            expected = elapsed * self._steps / max(self._span, 1)
            step += _SEQUENCES * max(0, round((expected - step) / _SEQUENCES))
        self._sequence += step
        self._microseconds += elapsed
        self._frames += 1
        self._steps += step
        self._span += elapsed
        return max(step - 1, 0)
