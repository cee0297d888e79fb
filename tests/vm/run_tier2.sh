#!/usr/bin/env bash
# Runs a command inside user-mode-linux: a Linux kernel as a program, with CAN, as any user and without hardware
# virtualisation. The guest sees this computer's files; what it writes is gone afterwards.
#   run_tier2.sh FOLDER COMMAND [ARGUMENT...]     FOLDER takes the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
folder=$(realpath -m "$1")
shift
here=$(dirname "$(realpath "$0")")

for package in user-mode-linux busybox-static; do
  [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] ||
    { echo "skipped: package $package is not installed; tools/setup.sh --tests installs it"; exit 77; }
done

mkdir -p "$folder"
{
  echo '#!/bin/sh'
  echo "export TMPDIR=/run NILIO_DATA='${NILIO_DATA:-}'"
  printf 'exec'
  printf ' %q' "$@"
} >"$folder/command.sh"
chmod +x "$folder/command.sh"

# The guest's memory is a file, sparse and deleted at once; not every machine has room for it in /tmp.
[[ -w /dev/shm ]] && export TMPDIR=/dev/shm
status=0
timeout -k 5 "${VM_TIMEOUT:-110}" linux.uml rootfstype=hostfs root=/dev/root rootflags=/ ro mem=768M quiet \
  con=null con0=null,fd:1 init="$here/tier2_init.sh" nilio_run="$folder/command.sh" </dev/null >"$folder/console.log" 2>&1 ||
  status=$?
tr -d '\r' <"$folder/console.log"
result=$(sed -n 's/.*nilio-guest-status=\([0-9]*\).*/\1/p' "$folder/console.log" | tail -1)
[[ -n $result ]] || { echo "run_tier2: the guest ended without a result (status $status; 124 = out of time)"; exit 1; }
exit "$result"
