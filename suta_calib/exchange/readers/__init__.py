"""Formats that can be read: one module each, which `exchange.reader` finds by looking."""
