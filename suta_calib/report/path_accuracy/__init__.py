"""How a recorded motion follows a reference, and how late poses come, shown."""
