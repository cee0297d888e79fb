#!/usr/bin/env bash
# Runs a command under Debian's own kernel in QEMU, with two emulated PCI CAN controllers on one bus. Needs neither root nor
# hardware virtualisation. The guest sees this computer's files; what it writes is gone afterwards.
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

: >"$folder/console.log"
: >"$folder/program.log"
# The processor is emulated also where KVM is at hand: it is quick enough, and every machine then does the same. One processor:
# with two, a burst overruns the emulated controller's buffer.
run_guest "$folder" qemu-system-x86_64 -M q35 -accel tcg,thread=multi -cpu max -smp 1 -m 1024 \
  -display none -vga none -nodefaults -no-user-config -no-reboot -monitor none -serial file:"$folder/console.log" \
  -kernel "$kernel/vmlinux" -initrd "$kernel/initrd.gz" \
  -append "console=ttyS0 quiet panic=-1 mitigations=off no_timer_check nilio_run=$folder/command.sh" \
  -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap -device virtio-9p-pci,fsdev=host,mount_tag=host \
  -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus
