"""Live calibrated poses: from readings to whoever listens, and how well they follow a motion."""
