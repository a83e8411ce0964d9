" Words of scores of ergon in YAML files that have a line `ergon:`, in Vim 9 and Neovim.

if search('^ergon:', 'nw') == 0
  finish
endif

" The word before it says what a word means: `do` that it transforms, a curve stands between points.
syntax match ergonKind /\v<(MAS|SOL|CEL|RES|FRO|REF|BUT|LNL|BRISTLE|DRY|MAGNET|STRING|PLATE|BANK|MODES|PROXY|CHAIN|CLOTH|DISC|BLOCK|BALL|MESH|GRAINS|SURFACE|ATTRACTION|ENX|ENF|SOX|SOV|SOA|SOE|SOF)>\ze:/ containedin=ALLBUT,yamlComment
syntax match ergonCurve /\v([0-9a-z)] )@<=(smooth|line|hold|throw)( [0-9+(-])@=/ containedin=ALLBUT,yamlComment
syntax match ergonUnit /\v<[0-9][0-9.]*\s*\zs(kN\/m|N\/m|Ns\/m|mNs|uNs|Ns|kHz|Hz|dB|kg|mg|g|nm|um|mm|cm|ms|bar|beats?|cents?|st|s|m|N|\%)\ze[^0-9A-Za-z_\/]/ containedin=ALLBUT,yamlComment
syntax match ergonStrength /\v[[:space:]:,[.]@<=((ppp|pp|p|mp|mf|f|ff|fff)!?|v[0-9]{1,3})\ze([[:space:],.\]}"'?*]|$)/ containedin=ALLBUT,yamlComment
syntax match ergonTransformation /\v(<do(:| ).*)@<=[0-9A-Za-z_:.-]@<!(arp|chunk|degrade|early|echo|euclid|every|fast|from|grace|iter|jitter|late|legato|mask|mirror|off|often|palindrome|ply|quantise|rarely|rev|reverse|roll|rolled|scale|shift|slow|sometimes|stretch|struct|strum|superimpose|swing|transpose|tremolo|whenmod)[0-9A-Za-z_:.-]@!/ containedin=ALLBUT,yamlComment

highlight default link ergonKind Type
highlight default link ergonCurve Statement
highlight default link ergonUnit Type
highlight default link ergonStrength Constant
highlight default link ergonTransformation Function
