"""Seeded random problems and independent checks of plans, for the benchmarks and the tests.

====================  ==============================================================================
`scene`               machine, support polygon, payload and slope of a problem as plain numbers
`paper`               test 1 of Song & Sharf 2020
`arm`                 random rest-to-rest motions of the arm, base at rest
`driving`             random motions of base and arm on a plane slope
`terrain`             random motions of base and arm over a heightmap
`checks`              limits, boundary values and ZMP of a plan, base at rest
`driving_checks`      the ZMP of a plan whose base drives, from the poses of its bodies
====================  ==============================================================================

A seed always gives the same problem, to the last bit: the files in benchmarks/results refer to
problems by their seeds. The tests import from here; nothing here imports from the tests.
"""
