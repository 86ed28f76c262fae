"""Closed problems on poses: registration, pivot, hand-eye, stereotactic navigation."""
