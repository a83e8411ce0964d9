;;; ergon.el --- Lines of a buffer to a session of ergon  -*- lexical-binding: t; -*-

;; Package-Requires: ((emacs "27.1"))
;; SPDX-License-Identifier: MIT OR Apache-2.0

;;; Commentary:

;; `ergon repl SCORE --socket' plays; M-x ergon-connect joins it.  In a buffer with `ergon-mode':
;; C-c C-c does the line, or the region as one version, C-c C-b the paragraph, C-c C-p is a panic.

;;; Code:

(require 'json)
(require 'subr-x)

(defgroup ergon nil "Sessions of ergon." :group 'multimedia)

(defcustom ergon-socket nil
  "The socket of the session; nil: the one of the user."
  :type '(choice (const :tag "The user's" nil) file))

(defvar ergon--process nil "The connection, or nil.")
(defvar ergon--rest "" "The beginning of a line that has not come whole.")
(defvar ergon--answer nil "What the greeting of a session at a port holds.")
(defvar ergon--number 0 "The id of the last request.")
(defvar ergon--asked (make-hash-table) "What each request asked for, by its id.")
(defvar ergon-answer "" "What was answered last.")

(defun ergon--place ()
  "The socket of the user's session."
  (or ergon-socket
      (let ((runtime (getenv "XDG_RUNTIME_DIR")))
        (if (and runtime (file-name-absolute-p runtime) (file-directory-p runtime))
            (expand-file-name "ergon/session.sock" runtime)
          (if (eq system-type 'windows-nt)
              (expand-file-name (format "ergon-%s/session.sock" (user-login-name))
                                temporary-file-directory)
            (format "/tmp/ergon-%d/session.sock" (user-uid)))))))

(defun ergon--address (place)
  "The port and the secrets of a session whose socket PLACE is a file (docs/socket.md).
Nil for a socket of Unix."
  (when (file-regular-p place)
    (let ((json-object-type 'alist))
      (json-read-file place))))

(defun ergon--say (text)
  "Show TEXT."
  (setq ergon-answer text)
  (message "%s" text))

(defun ergon--reply (is)
  "Show the reply IS to a line."
  (let ((taken (eq (alist-get 'taken is) t))
        (try (alist-get 'try is))
        (lines (append (alist-get 'lines is) nil)))
    (ergon--say
     (string-join
      (append (list (concat (if taken "" "not taken: ") (alist-get 'text is)))
              (when (stringp try) (list (concat "try: " try)))
              lines)
      "\n"))))

(defun ergon--heard (line)
  "Act on a LINE of the session's: the greeting, an answer, or the end."
  (let* ((json-object-type 'alist)
         (said (ignore-errors (json-read-from-string line)))
         (id (alist-get 'id said))
         (do (and id (gethash id ergon--asked))))
    (when id (remhash id ergon--asked))
    (cond
     ((alist-get 'ended said)
      (ergon--say (concat "the session has ended: " (alist-get 'ended said))))
     ((and (alist-get 'ergon said) (not (equal (alist-get 'answer said) ergon--answer)))
      (ergon--say "another program has taken the port of the session")
      (ergon-leave))
     ((alist-get 'ergon said)
      (ergon--say (if (equal (alist-get 'ergon said) 1)
                      (concat "joined " (or (alist-get 'score said) "a session"))
                    "this session speaks another protocol")))
     ((alist-get 'error said) (ergon--say (alist-get 'error said)))
     ((equal do "submit") (ergon--reply (alist-get 'is said)))
     ((equal do "panic") (ergon--say "panic: no sound, no force; `release' ends it")))))

(defun ergon--came (_process text)
  "Act on every whole line of TEXT."
  (let ((lines (split-string (concat ergon--rest text) "\n")))
    (setq ergon--rest (car (last lines)))
    (mapc #'ergon--heard (butlast lines))))

(defun ergon--gone (_process _event)
  "Note that the connection is closed."
  (setq ergon--process nil)
  (ergon--say "the session is gone; M-x ergon-connect joins another"))

(defun ergon-connect (&optional path)
  "Join the session at the socket PATH; without one, that of the user."
  (interactive "fSocket: ")
  (ergon-leave)
  (setq ergon--rest "")
  (let* ((place (expand-file-name (or path (ergon--place))))
         (address (ergon--address place)))
    (setq ergon--answer (alist-get 'answer address))
    (condition-case nil
        (progn
          (setq ergon--process
                (apply #'make-network-process
                       :name "ergon" :coding 'utf-8 :filter #'ergon--came
                       :sentinel #'ergon--gone :noquery t
                       (if address
                           (list :host "127.0.0.1" :service (alist-get 'port address))
                         (list :family 'local :service place))))
          (when address
            (process-send-string ergon--process (concat (alist-get 'key address) "\n"))))
      (file-error
       (ergon--say
        (format "no session is served at %s: ergon repl SCORE --socket begins one" place))))))

(defun ergon-leave ()
  "Leave the session; the music goes on."
  (interactive)
  (when (process-live-p ergon--process)
    (set-process-sentinel ergon--process #'ignore)
    (delete-process ergon--process))
  (setq ergon--process nil))

(defun ergon--ask (do &rest fields)
  "Ask for DO with FIELDS, an alist."
  (unless (process-live-p ergon--process) (ergon-connect))
  (when (process-live-p ergon--process)
    (setq ergon--number (1+ ergon--number))
    (puthash ergon--number do ergon--asked)
    (process-send-string
     ergon--process
     (concat (json-encode (append `((id . ,ergon--number) (do . ,do)) fields)) "\n"))))

(defun ergon-send-region (start end)
  "Do the lines from START to END as one version."
  (interactive "r")
  (ergon--ask "submit" (cons 'text (buffer-substring-no-properties start end))))

(defun ergon-send-line ()
  "Do the line, or the region where one is active."
  (interactive)
  (if (use-region-p)
      (ergon-send-region (region-beginning) (region-end))
    (ergon-send-region (line-beginning-position) (line-end-position))))

(defun ergon-send-block ()
  "Do the paragraph as one version."
  (interactive)
  (save-excursion
    (let ((end (progn (forward-paragraph) (point))))
      (backward-paragraph)
      (ergon-send-region (point) end))))

(defun ergon-panic ()
  "Silence and no force, at once."
  (interactive)
  (ergon--ask "panic"))

(defvar ergon-mode-map
  (let ((map (make-sparse-keymap)))
    (define-key map (kbd "C-c C-c") #'ergon-send-line)
    (define-key map (kbd "C-c C-b") #'ergon-send-block)
    (define-key map (kbd "C-c C-p") #'ergon-panic)
    map)
  "Keys of `ergon-mode'.")

;; Colours of scores: what a word means by the word before it, as in editors/vim.

(defconst ergon-keywords
  '(("\\_<\\(?:MAS\\|SOL\\|CEL\\|RES\\|FRO\\|REF\\|BUT\\|LNL\\|BRISTLE\\|DRY\\|MAGNET\\|STRING\\|PLATE\\|BANK\\|MODES\\|PROXY\\|CHAIN\\|CLOTH\\|DISC\\|BLOCK\\|BALL\\|MESH\\|GRAINS\\|SURFACE\\|ATTRACTION\\|ENX\\|ENF\\|SO[XVAEF]\\):"
     (0 font-lock-type-face t))
    ("[0-9a-z)] \\(smooth\\|line\\|hold\\|throw\\) [0-9+(-]" (1 font-lock-keyword-face t))
    ("\\_<[0-9][0-9.]*\\(kN/m\\|N/m\\|Ns/m\\|mNs\\|uNs\\|Ns\\|kHz\\|Hz\\|dB\\|kg\\|mg\\|g\\|nm\\|um\\|mm\\|cm\\|ms\\|bars?\\|beats?\\|cents?\\|st\\|s\\|m\\|N\\|%\\)\\(?:[^0-9A-Za-z_/]\\|$\\)"
     (1 font-lock-builtin-face t))
    ("[ :,[]\\(\\(?:ppp\\|pp\\|mp\\|mf\\|fff\\|ff\\|p\\|f\\)!?\\)\\(?:[] ,.}\"'?*]\\|$\\)" (1 font-lock-constant-face t)))
  "What is coloured in scores of ergon, as of `font-lock-keywords'.")

;;;###autoload
(defun ergon-colour ()
  "Colour this buffer if it is a score: a line of it begins with `ergon:'."
  (when (save-excursion (goto-char (point-min)) (re-search-forward "^ergon:" nil t))
    (font-lock-add-keywords nil ergon-keywords t)
    (font-lock-flush)))

;;;###autoload
(dolist (hook '(yaml-mode-hook yaml-ts-mode-hook))
  (add-hook hook #'ergon-colour))

;;;###autoload
(define-minor-mode ergon-mode
  "Send lines of this buffer to a session of ergon."
  :lighter " ergon" :keymap ergon-mode-map)

(provide 'ergon)
;;; ergon.el ends here
