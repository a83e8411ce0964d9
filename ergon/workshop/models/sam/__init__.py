"""Models of Synth-A-Modeler: read, and written as a score."""
