"""A plan, shown and written for the bench."""
