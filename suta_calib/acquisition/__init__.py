"""From a stream of readings to samples files: rests, averages, the guided protocol, a baseline."""
