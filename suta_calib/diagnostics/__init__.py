"""What a fit and its data say of each other: errors, repeats, what is missing, what is not told."""
