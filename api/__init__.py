"""What `import ergon` offers: check, plan, render and freeze a score, or open it as a session.

Which of its names are public is said in core-rs/python/ergon/__init__.py.
"""
