"""What a driving base adds to the nonlinear program."""
