"""Measurements of the planner; each is a command: `python -m benchmarks.NAME --help`.

====================  ==============================================================================
`speed`               how long planning takes
`random_problems`     robustness and speed on random problems of the arm
`robust_problems`     what uncertain payloads and slopes cost
`driving_problems`    robustness and speed for base and arm on a slope
`terrain_drives`      robustness and speed for base and arm over a heightmap
`recorded`            whether a change of the code changes any result
`memory`              whether many plans leave the memory flat
`peer_ipopt`          the same problems solved by CasADi and IPOPT
`peers`               IPOPT and fatrop, interpreted and compiled, Drake and TOPP-RA, side by side
`replay`              verdicts of the certificate against MuJoCo
`paper`               Song & Sharf 2020 beside our numbers, and the tables of docs/paper.md
====================  ==============================================================================

`harness` holds what they share, `problems` the seeded problems and the checks of plans, `results`
the recorded numbers.
"""
