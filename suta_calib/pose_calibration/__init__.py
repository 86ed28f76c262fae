"""Pivot, hand-eye and registration: the same terms over measured poses, robust."""
