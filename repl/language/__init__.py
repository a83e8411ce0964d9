"""The language of the prompt: a line becomes commands, or a refusal with its place and a suggested
line.
"""
