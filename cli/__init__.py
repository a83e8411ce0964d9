"""The command line: one file per command, which reads options, calls `ergon.api` and prints."""
