"""What one does with matter and keys beside playing them: models of other programs, keys that are
measured, bells that are found, charts, films, an editor's server. Nothing outside uses it but the
commands and the table of public names; both import it when it is called.
"""
