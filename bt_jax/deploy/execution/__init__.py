"""Ticking a tree on a robot: what is observed, what each leaf returns, the actions, limits, the log."""
