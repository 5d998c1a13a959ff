"""Uneven ground: a smooth surface through measured heights, and a base that drives on it."""
