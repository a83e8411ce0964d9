"""From a checked piece to the network and the timeline that play it."""
