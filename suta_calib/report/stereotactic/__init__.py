"""Stereotactic navigation, shown."""
