# What the scripts of both tiers share; sourced.

# Exit status that ctest takes as "skipped".
readonly kSkipped=77

# need PROGRAM:PACKAGE...: ends with one line that names what is missing.
need() {
  local entry missing=()
  for entry in "$@"; do
    command -v "${entry%%:*}" >/dev/null || missing+=("${entry#*:}")
  done
  ((${#missing[@]} == 0)) && return
  echo "skipped: packages not installed: ${missing[*]}; tools/setup.sh --tests installs them"
  exit "$kSkipped"
}

# write_command FOLDER ASSIGNMENT COMMAND [ARGUMENT...]: what the guest's first process executes.
write_command() {
  local file=$1/command.sh assignment=$2
  shift 2
  {
    echo '#!/bin/sh'
    echo "export TMPDIR=/run $assignment"
    printf 'exec'
    printf ' %q' "$@"
    echo
  } >"$file"
  chmod +x "$file"
}

# run_guest FOLDER PROGRAM [ARGUMENT...]: ends with the status of the guest's command, which the guest's console in
# FOLDER/console.log tells. A guest that ends without one may hang or have starved: the run has failed, and how much of a
# processor the guest was given is said.
run_guest() {
  local folder=$1 limit=${VM_TIMEOUT:-560} status=0 result wall user system
  shift
  local TIMEFORMAT='%R %U %S'
  { time timeout -k 5 "$limit" "$@" </dev/null >>"$folder/program.log" 2>&1 || status=$?; } 2>"$folder/times"
  read -r wall user system < <(tail -1 "$folder/times")
  tr -d '\r' <"$folder/console.log"
  echo "guest: $wall s, of them $user s + $system s of processor time; load average $(cut -d' ' -f1-3 /proc/loadavg)"
  result=$(sed -n 's/.*nilio-guest-status=\([0-9]*\).*/\1/p' "$folder/console.log" | tail -1)
  # What a starved guest could not decide has not passed, even where all else has.
  [[ $result == 0 ]] && grep --quiet '^undecided:' "$folder/console.log" && exit "$kSkipped"
  [[ -n $result ]] && exit "$result"
  tail -5 "$folder/program.log"
  if ((status == 124)); then
    echo "failed: the guest was not done after $limit s; run it again on a quieter machine, or with a larger VM_TIMEOUT (s)"
  else
    echo "failed: the guest ended without a result, with status $status; see $folder"
  fi
  exit 1
}
