"""Parts of a score as programs of others: Faust, mi-gen, Csound."""
