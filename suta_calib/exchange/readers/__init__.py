"""Formats that can be read: one module each, found by looking (`exchange.reader.readers`)."""
