"""Motions and bounds in closed form: phase-plane baseline, analytic slew, base beside an arm."""
