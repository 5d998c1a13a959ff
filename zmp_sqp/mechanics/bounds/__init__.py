"""Rigorous bounds on the ground reaction and its time derivatives."""
