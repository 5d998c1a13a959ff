"""Proof that a motion keeps its limits at all times."""
