"""A small score for the tests of commands, with a ramp, marks and a gesture not played."""

SCORE = """\
ergon: 1
title: One bell
tempo:
  - {at: 1|1, bpm: 120, meter: 4/4}
  - {at: 3|1, bpm: 120 -> 60, over: 4}
marks: {A: 1|1, B: 2|3}
keys:
  k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
  lean: 0mm@0 smooth 3mm@1 smooth 0mm@2
players:
  ada: {hand: virtual, key: k1}
parts:
  ada:
    - {at: A, play: knock, every: 1, times: 2}
mix: {channels: 2, route: [{from: bell, to: [1, 2]}]}
render: {bits: 24, tail: 1s}
"""
