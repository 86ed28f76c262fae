"""A choice among models, shown."""
