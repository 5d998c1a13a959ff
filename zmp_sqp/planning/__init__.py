"""From a problem to a plan: transcription in normalised time, SQP, trajectory, baseline."""
