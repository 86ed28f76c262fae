"""How many sets a calibration needs, and how much its answer varies: trials run anywhere."""
