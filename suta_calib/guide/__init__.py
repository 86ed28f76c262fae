"""A page in the browser that leads through a measurement (an extra)."""
