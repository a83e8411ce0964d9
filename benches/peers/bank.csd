<CsoundSynthesizer>
<CsInstruments>
; One `mode` for each oscillator, all summed; the notes are written by the bench.
sr = 44100
ksmps = 256
nchnls = 1
0dbfs = 1
gasum init 0
instr 1
  astart mpulse 1, 0
  aout mode astart, p4, p5 ; frequency, quality
  gasum += aout
endin
instr 2
  out gasum
  clear gasum
endin
</CsInstruments>
<CsScore>
@NOTES@
</CsScore>
</CsoundSynthesizer>
