"""Parts of a score written as programs for Faust, mi-gen and Csound."""
