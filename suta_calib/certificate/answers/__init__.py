"""One file for each answer that can be certified."""
