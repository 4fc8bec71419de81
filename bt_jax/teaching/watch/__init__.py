"""Demonstrations that a camera watches: a person moves boxes by hand, and what was moved where is recorded."""
