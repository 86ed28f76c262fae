"""How far to trust a calibration."""
