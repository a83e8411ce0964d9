"""A staged piece computed offline: into files, frozen parts, rows of ergons, reports."""
