"""The mechanical model of a real key, identified from applied forces and measured positions."""
