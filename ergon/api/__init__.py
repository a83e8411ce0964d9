"""What `import ergon` offers: check, plan, render and freeze a score, or open it as a session.

ergon/__init__.py says which of these names are public.
"""
