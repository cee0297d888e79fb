# bash completion of nilio and niliod. Commands, options and choices are those that --help lists.
_nilio() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} help word
  local -a command=("${COMP_WORDS[0]}")
  help=$("${command[@]}" --help 2>/dev/null) || return
  _nilio_commands() { sed -n '/^Subcommands:$/,/^$/s/^  \([a-z][a-z0-9-]*\).*/\1/p' <<<"$help"; }
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    if _nilio_commands | grep -qxF -- "$word"; then
      command+=("$word")
      help=$("${command[@]}" --help 2>/dev/null) || return
    fi
  done

  local words
  # Lists of choices that --help breaks after a comma.
  help=$(sed -e ':next' -e '/,$/{N;s/,\n */,/;b next' -e '}' <<<"$help")
  if [[ $previous == -* ]] && words=$(sed -nE "s/^ *([^ ]*,)?$previous(,[^ ]*)? [A-Z]+:\{([^}]*)\}.*/\3/p" <<<"$help") && [[ -n $words ]]; then
    words=${words//,/ }
  elif [[ $current == -* ]]; then
    words=$(sed -nE 's/^  (-[^ ]+)( .*)?$/\1/p' <<<"$help" | tr , '\n' | grep '^--')
  else
    words=$(_nilio_commands)
  fi
  # No candidates: bash completes file names.
  mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
}
complete -o default -F _nilio nilio niliod
