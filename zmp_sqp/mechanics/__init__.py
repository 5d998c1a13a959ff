"""From a URDF to the ground reaction wrench and the zero moment point, with derivatives. Knows no optimisation."""
