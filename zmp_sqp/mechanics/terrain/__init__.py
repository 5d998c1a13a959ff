"""Uneven ground: a smooth surface through measured heights, and how a base drives on it."""
