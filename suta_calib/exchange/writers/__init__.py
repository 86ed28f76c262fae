"""Formats that can be written: one module each, found by looking (`exchange.writer.writers`)."""
