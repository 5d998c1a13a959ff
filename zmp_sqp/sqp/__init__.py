"""Sequential quadratic programming for nonlinear programs with stages. Knows no robot."""
