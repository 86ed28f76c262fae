"""An acceptance test, shown."""
