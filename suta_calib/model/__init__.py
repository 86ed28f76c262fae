"""The arm whose geometry is unknown."""
