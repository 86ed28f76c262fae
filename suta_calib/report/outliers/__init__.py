"""Outliers, shown."""
