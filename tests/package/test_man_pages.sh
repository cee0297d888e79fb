#!/usr/bin/env bash
# Every command and option of --help is in the man pages and offered by the completion.
#   test_man_pages.sh BUILD_FOLDER
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
build=$1
# shellcheck source=../../cmake/package/completion.bash
source "$source_dir/cmake/package/completion.bash"
failed=0
checked=0
complain() { echo "$1" >&2; failed=1; }

# complete WORD...: the completions of the last word.
complete_words() {
  COMP_WORDS=("$build/bin/$1" "${@:2}")
  COMP_CWORD=$(($# - 1))
  COMPREPLY=()
  _nilio
}

# check PAGE WORD...: the command line of words, and its subcommands.
check() {
  local page=$1 help option names name commands
  shift
  help=$("$build/bin/$1" "${@:2}" --help)
  complete_words "$@" --
  for option in $(awk '/^  -/ { n = split($1, names, ","); for (i = 1; i <= n; ++i) if (names[i] ~ /^--/) print names[i] }' <<<"$help"); do
    ((++checked))
    grep -qE -- "${option//-/\\\\-}(,|\\\\fR)" "$page" || complain "$page: no $option of '$*'"
    [[ " ${COMPREPLY[*]} " == *" $option "* || $1 == nilio-publisher || $1 == nilio-mapper ]] || complain "completion: no $option of '$*'"
  done
  names=$(awk '/^Subcommands:$/ { list = 1; next } /^$/ { list = 0 } list && /^  [a-z]/ { print $1 }' <<<"$help")
  complete_words "$@" ''
  commands=" ${COMPREPLY[*]} "
  for name in $names; do
    grep -q "^\.SS.* $name\$" "$page" || complain "$page: no section of '$* $name'"
    [[ $commands == *" $name "* ]] || complain "completion: no command '$* $name'"
  done
  for name in $names; do
    check "$page" "$@" "$name"
  done
}

check "$build/man/niliod.8" niliod
check "$build/man/nilio-publisher.8" nilio-publisher
check "$build/man/nilio-mapper.8" nilio-mapper
check "$build/man/nilio.1" nilio
((checked > 100)) || complain "only $checked options found in --help"
complete_words nilio simulate --scene t
[[ ${COMPREPLY[*]} == "town tunnel three_point_turn" ]] || complain "completion: 'nilio simulate --scene t' gives '${COMPREPLY[*]}'"

if command -v groff >/dev/null; then
  for page in "$build"/man/*.[18]; do
    warnings=$(groff -man -Tutf8 -wmac -Wbreak -z "$page" 2>&1)
    [[ -z $warnings ]] || complain "$warnings"
  done
else
  echo "skipped: man pages: groff is not installed, their syntax is not checked"
fi
((failed)) || echo "$checked options in man pages and completion"
exit $failed
