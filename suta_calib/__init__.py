"""Kinematic calibration of serial arms from their URDF."""
