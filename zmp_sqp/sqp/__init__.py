"""Sequential quadratic programming for sparse nonlinear programs; independent of robotics."""
