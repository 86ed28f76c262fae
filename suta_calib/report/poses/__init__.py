"""Pivot, hand-eye and registration, shown."""
