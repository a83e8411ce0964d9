"""A staged piece computed as fast as it goes: into files, frozen parts, rows of ergons, reports."""
