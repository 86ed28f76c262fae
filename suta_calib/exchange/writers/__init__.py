"""Formats that can be written: one module each, which `exchange.writer` finds by looking."""
