#!/usr/bin/env bash
# Runs a command under Debian's own kernel in QEMU, with two emulated PCI CAN controllers on one bus. Needs neither root nor
# hardware virtualisation. The guest sees this computer's files; its writes are discarded.
#   run_tier3.sh FOLDER KERNEL COMMAND [ARGUMENT...]    KERNEL: folder of tier3_prepare.sh, shared by builds
# FOLDER takes the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
# shellcheck source=guest.sh
source "$(dirname "$(realpath "$0")")/guest.sh"
prepare_debian_guest "$1" "$2"
shift 2
write_command "$folder" "NILIO_KERNEL='$kernel'" "$@"

boot_debian_kernel "$folder" "$kernel" "nilio_run=$folder/command.sh" "${kCanControllers[@]}"
end_as_guest "$folder"
