"""The laboratory: error, cost and stability of each way of computing a scene."""
