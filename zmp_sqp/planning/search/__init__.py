"""Search for a plan of a problem: explore, refine, prove; messages and diagnosis."""
