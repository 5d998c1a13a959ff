"""What is asked: the planning problem and its parts."""
