#!/usr/bin/env bash
# Runs a command under Debian's own kernel in QEMU, with two emulated PCI CAN controllers on one bus. Needs neither root nor
# hardware virtualisation. The guest sees this computer's files; its writes are discarded.
#   run_tier3.sh FOLDER KERNEL COMMAND [ARGUMENT...]    KERNEL: folder of tier3_prepare.sh, shared by builds
# FOLDER takes the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
here=$(dirname "$(realpath "$0")")
# shellcheck source=guest.sh
source "$here/guest.sh"
folder=$(realpath -m "$1")
kernel=$(realpath -m "$2")
shift 2

need qemu-system-x86_64:qemu-system-x86
"$here/tier3_prepare.sh" --offline "$kernel"
mkdir -p "$folder"
write_command "$folder" "NILIO_KERNEL='$kernel'" "$@"

boot_debian_kernel "$folder" "$kernel" "nilio_run=$folder/command.sh" -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus
end_as_guest "$folder"
