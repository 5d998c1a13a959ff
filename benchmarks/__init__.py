"""Measurements of robustness and speed: python -m benchmarks.random_problems, python -m benchmarks.speed."""
