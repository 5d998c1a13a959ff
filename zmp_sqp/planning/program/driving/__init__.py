"""Driving base in the nonlinear program: its dynamics, displacements and positions."""
