"""Studies, shown."""
