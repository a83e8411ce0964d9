"""What `import ergon` and the commands offer of the workshop."""
