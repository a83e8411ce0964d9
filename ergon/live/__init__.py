"""A staged piece played on a sound card and on force-feedback devices."""
