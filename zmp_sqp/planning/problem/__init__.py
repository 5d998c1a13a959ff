"""The planning problem: machine, start, goal, ground, base, and the checks of all of them."""
