"""The laboratory: error, cost and stability of each method of computing a scene."""
