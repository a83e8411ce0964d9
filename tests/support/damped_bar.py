"""A bar whose notes are damped where they end."""

SCORE = """\
ergon: 1
instruments:
  bar:
    f: A4
    modules: {m: {CEL: {M: 20g, f: A4, t60: 9s}}}
    notes: C4..C5
    out: {SOV: m}
    play:
      strike:
        at: m
        impulse: 0.1Ns..1Ns
        release: {at: damper, impulse: 20mNs}
        with:
          damper: {MAS: {M: 20g, X0: 5mm}}
          ground: {SOL: {}}
          guide: {FRO: {between: [ground, damper], Z: 4Ns/m}}
          pad:
            LNL:
              between: [ground, m]
              damping: z*v
              follows: {z: {of: damper, from: 0Ns/m, to: 2Ns/m, span: 5mm}}
"""
