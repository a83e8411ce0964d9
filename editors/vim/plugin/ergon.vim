" Lines of a buffer to a session of `ergon repl SCORE --socket`, in Vim 9 and Neovim.
"
" :ErgonConnect [PATH]   joins the session at a socket; without PATH the one of the user
" :[range]ErgonSend      does the line, or a block of lines as one version
" :ErgonPanic            silence and no force, at once
" :ErgonLeave            leaves; the music goes on

if exists('g:loaded_ergon')
  finish
endif
let g:loaded_ergon = 1

let s:channel = v:null
let s:number = 0
let s:asked = {}
let s:rest = ''
let s:answer = ''
" What was answered last, for status lines and tests.
let g:ergon_answer = ''

function! s:place() abort
  let l:runtime = exists('$XDG_RUNTIME_DIR') ? $XDG_RUNTIME_DIR : ''
  if l:runtime =~# '^/' && isdirectory(l:runtime)
    return l:runtime . '/ergon/session.sock'
  endif
  if has('win32')
    return $TEMP . '\ergon-' . $USERNAME . '\session.sock'
  endif
  return '/tmp/ergon-' . trim(system('id -u')) . '/session.sock'
endfunction

" The port and the secrets of a session whose socket is a file (docs/socket.md); {} for a socket of Unix.
function! s:address(path) abort
  return getftype(a:path) ==# 'file' ? json_decode(join(readfile(a:path), '')) : {}
endfunction

function! s:say(text, is_error) abort
  let g:ergon_answer = a:text
  if a:is_error
    echohl WarningMsg
  endif
  for l:line in split(a:text, "\n")
    echomsg l:line
  endfor
  echohl None
endfunction

" One line of the session's: the greeting, an answer, or the end.
function! s:heard(line) abort
  try
    let l:said = json_decode(a:line)
  catch
    return
  endtry
  if type(l:said) != v:t_dict
    return
  endif
  if has_key(l:said, 'ended')
    call s:say('the session has ended: ' . l:said.ended, 1)
  elseif has_key(l:said, 'ergon') && get(l:said, 'answer', '') !=# s:answer
    call s:say('another program has taken the port of the session', 1)
    call s:leave()
  elseif has_key(l:said, 'ergon')
    call s:say(l:said.ergon == 1 ? 'joined ' . get(l:said, 'score', 'a session')
          \ : 'this session speaks another protocol', l:said.ergon != 1)
  elseif has_key(l:said, 'error')
    call s:say(l:said.error, 1)
  elseif has_key(l:said, 'is')
    let l:do = get(s:asked, get(l:said, 'id', -1), '')
    if l:do ==# 'submit' && type(l:said.is) == v:t_dict
      let l:is = l:said.is
      let l:text = (l:is.taken ? '' : 'not taken: ') . l:is.text
      if type(get(l:is, 'try', v:null)) == v:t_string
        let l:text .= "\ntry: " . l:is.try
      endif
      call s:say(join([l:text] + l:is.lines, "\n"), !l:is.taken)
    elseif l:do ==# 'panic'
      call s:say('panic: no sound, no force; `release` ends it', 1)
    endif
  endif
  if has_key(l:said, 'id') && has_key(s:asked, l:said.id)
    call remove(s:asked, l:said.id)
  endif
endfunction

function! s:came(_channel, line) abort
  call s:heard(a:line)
endfunction

function! s:gone(_channel) abort
  let s:channel = v:null
  call s:say('the session is gone; :ErgonConnect joins another', 1)
endfunction

" Neovim hands over pieces: the last one of each is the beginning of the next line.
function! s:came_in_pieces(_channel, pieces, _event) abort
  if a:pieces ==# ['']
    call s:gone(0)
    return
  endif
  let l:pieces = copy(a:pieces)
  let l:pieces[0] = s:rest . l:pieces[0]
  let s:rest = remove(l:pieces, -1)
  for l:line in l:pieces
    call s:heard(l:line)
  endfor
endfunction

function! s:connect(path) abort
  call s:leave()
  let l:path = empty(a:path) ? s:place() : fnamemodify(a:path, ':p')
  try
    let l:address = s:address(l:path)
    let l:port = empty(l:address) ? '' : '127.0.0.1:' . l:address.port
    let s:answer = get(l:address, 'answer', '')
    if has('nvim')
      let s:channel = sockconnect(empty(l:port) ? 'pipe' : 'tcp', empty(l:port) ? l:path : l:port,
            \ {'on_data': function('s:came_in_pieces')})
    else
      let s:channel = ch_open(empty(l:port) ? 'unix:' . l:path : l:port,
            \ {'mode': 'nl', 'callback': function('s:came'), 'close_cb': function('s:gone')})
      if ch_status(s:channel) !=# 'open'
        let s:channel = v:null
      endif
    endif
    if s:channel isnot v:null && !empty(l:port)
      call s:send(l:address.key)
    endif
  catch
    let s:channel = v:null
  endtry
  if s:channel is v:null
    call s:say('no session is served at ' . l:path . ': ergon repl SCORE --socket begins one', 1)
  endif
endfunction

function! s:ask(do, fields) abort
  if s:channel is v:null
    call s:connect('')
    if s:channel is v:null
      return
    endif
  endif
  let s:number += 1
  let s:asked[s:number] = a:do
  call s:send(json_encode(extend({'id': s:number, 'do': a:do}, a:fields)))
endfunction

function! s:send(line) abort
  if has('nvim')
    call chansend(s:channel, a:line . "\n")
  else
    call ch_sendraw(s:channel, a:line . "\n")
  endif
endfunction

function! s:leave() abort
  if s:channel is v:null
    return
  endif
  let l:channel = s:channel
  let s:channel = v:null
  if has('nvim')
    call chanclose(l:channel)
  else
    call ch_close(l:channel)
  endif
endfunction

command! -nargs=? -complete=file ErgonConnect call s:connect(<q-args>)
command! -range ErgonSend call s:ask('submit', {'text': join(getline(<line1>, <line2>), "\n")})
command! ErgonPanic call s:ask('panic', {})
command! ErgonLeave call s:leave()

nnoremap <silent> <Plug>(ErgonSend) :ErgonSend<CR>
xnoremap <silent> <Plug>(ErgonSend) :ErgonSend<CR>
nnoremap <silent> <Plug>(ErgonBlock) vip:ErgonSend<CR>
