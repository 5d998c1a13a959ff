"""Transcription of a planning problem into a nonlinear program."""
