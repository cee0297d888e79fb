#!/usr/bin/env bash
# Runs a command inside user-mode-linux: a Linux kernel as a program, with CAN, as any user and without hardware
# virtualisation. The guest sees this computer's files; its writes are discarded. Falls back to Debian's
# kernel in QEMU.
#   run_tier2.sh FOLDER KERNEL COMMAND [ARGUMENT...]    KERNEL: folder of tier3_prepare.sh, shared by builds
# FOLDER takes the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
here=$(dirname "$(realpath "$0")")
# shellcheck source=guest.sh
source "$here/guest.sh"
folder=$(realpath -m "$1")
kernel=$(realpath -m "$2")
shift 2

need linux.uml:user-mode-linux busybox:busybox-static
mkdir -p "$folder"
write_command "$folder" "NILIO_DATA='${NILIO_DATA:-}'" "$@"

# The guest's memory is a sparse, deleted file with executable pages. In containers /dev/shm is often too small or mounted
# noexec.
memory_mib=768
has_room() {
  [[ -w $1 ]] && (($(df --output=avail --block-size=1M "$1" | tail -1) > memory_mib)) &&
    ! findmnt --noheadings --output OPTIONS --target "$1" | grep --quiet --word-regexp noexec
}
for TMPDIR in /dev/shm "${TMPDIR:-/tmp}" "$folder"; do
  has_room "$TMPDIR" && break
done
export TMPDIR

# Kernel and processes of the guest are processes of this computer that run in turns. On one processor they switch directly;
# otherwise each waits for a free processor.
processor=$(taskset --cpu-list --pid $$ | sed 's/.*: //; s/[-,].*//')
run_guest "$folder" taskset --cpu-list "$processor" linux.uml rootfstype=hostfs root=/dev/root rootflags=/ ro "mem=${memory_mib}M" quiet \
  uml_dir="$folder/" con=null "con0=null,fd:3" init="$here/tier2_init.sh" nilio_run="$folder/command.sh" 3>"$folder/console.log"

# That kernel (6.1) has a fixed size for the floating-point registers of its processes; Linux refuses to set a part of them, and
# processors with AMX have more.
if grep --quiet 'ptrace set fp regs failed' "$folder/console.log"; then
  echo "user-mode-linux cannot run processes on this processor, which has more registers than it knows; Debian's kernel does it, in QEMU"
  need qemu-system-x86_64:qemu-system-x86
  "$here/tier3_prepare.sh" --offline "$kernel"
  boot_debian_kernel "$folder" "$kernel" "nilio_run=$folder/command.sh"
fi
end_as_guest "$folder"
