"""An inclinometer on an arm: what a package outside `suta_calib` adds by entry points."""
