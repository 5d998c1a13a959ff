"""The nonlinear program of a planning problem."""
