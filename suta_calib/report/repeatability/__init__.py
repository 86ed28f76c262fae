"""Repeatability and encoders at rest, shown."""
