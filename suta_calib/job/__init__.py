"""Jobs: files that say what to calibrate or to test, read once, typed."""
