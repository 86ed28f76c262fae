"""Stereotactic navigation: two trackers, distortion and CT, in JHU's CIS files."""
