#!/usr/bin/env bash
# Writes a man page: a template with the options, commands and exit status of the program's own --help.
#   man_page.sh PROGRAM VERSION TEMPLATE PAGE
set -euo pipefail
folder=$(cd "$(dirname "$0")" && pwd)
program=$1
version=$2
template=$3
page=$4

convert() { awk -v PART="$1" -f "$folder/help_to_man.awk"; }

# Sections of all commands below the command line "$@".
commands() {
  local help name
  help=$("$program" "$@" --help)
  for name in $(sed -n '/^Subcommands:$/,/^$/s/^  \([a-z][a-z0-9-]*\).*/\1/p' <<<"$help"); do
    local own
    own=$("$program" "$@" "$name" --help)
    printf '.SS %s\n' "$*${*:+ }$name"
    sed '/^Usage:/,$d' <<<"$own" | sed 's/^./\u&/; s/[^.]$/&./'
    convert options <<<"$own"
    printf '.PP\n'
    convert notes <<<"$own"
    commands "$@" "$name"
  done
}

help=$("$program" --help)
while IFS= read -r line; do
  case $line in
    @OPTIONS@) convert options <<<"$help" ;;
    @COMMANDS@) commands ;;
    @COMMAND_LIST@) convert commands <<<"$help" ;;
    @EXIT_STATUS@) convert exit_status <<<"$help" | sed 's/^Exit status: *//; 1s/^./\u&/' ;;
    *) printf '%s\n' "${line//@VERSION@/$version}" ;;
  esac
done <"$template" >"$page.new"
mv "$page.new" "$page"
