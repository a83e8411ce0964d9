"""The decay of vibrations by time."""

LN_1000 = 6.907755278982137  # what falls as e^(-σt) falls by 60 dB in T60 = LN_1000/σ
