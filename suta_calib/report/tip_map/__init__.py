"""The tip uncertainty over the workspace, shown."""
