"""Tables of fields: they read, check and describe a score, and generate the editor's JSON
schema.
"""
