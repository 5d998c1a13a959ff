"""Baselines, bounds and motions that need no search."""
