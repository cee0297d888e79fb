#!/usr/bin/env bash
# Runs a command under Debian's own kernel in QEMU, with two emulated PCI CAN controllers on one bus. Needs neither root nor
# hardware virtualisation. The guest sees this computer's files; what it writes is gone afterwards.
#   run_tier3.sh FOLDER KERNEL COMMAND [ARGUMENT...]    KERNEL: folder of tier3_prepare.sh, shared by builds
# FOLDER takes the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
folder=$(realpath -m "$1")
kernel=$(realpath -m "$2")
shift 2
here=$(dirname "$(realpath "$0")")

for package in qemu-system-x86 busybox-static cpio kmod xz-utils; do
  [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] ||
    { echo "skipped: package $package is not installed; tools/setup.sh --tests installs it"; exit 77; }
done
if ! compgen -G "$kernel/linux-image-*.deb" >/dev/null && ! "$here/tier3_prepare.sh" "$kernel"; then
  echo "skipped: the kernel's packages are not in $kernel and cannot be downloaded; tools/setup.sh --tests does"
  exit 77
fi
"$here/tier3_prepare.sh" "$kernel"

mkdir -p "$folder"
{
  echo '#!/bin/sh'
  echo "export TMPDIR=/run NILIO_KERNEL='$kernel'"
  printf 'exec'
  printf ' %q' "$@"
} >"$folder/command.sh"
chmod +x "$folder/command.sh"

# /dev/kvm is also there where a guest kernel would hang in it: only with real hardware virtualisation.
accelerator=tcg,thread=multi
processor=max
if [[ -w /dev/kvm ]] && grep -qE '^flags.*\b(vmx|svm)\b' /proc/cpuinfo; then
  accelerator=kvm
  processor=host
fi
status=0
# One processor: with two, a burst overruns the emulated controller's buffer.
timeout -k 5 "${VM_TIMEOUT:-150}" qemu-system-x86_64 -M q35 -accel "$accelerator" -cpu "$processor" -smp 1 -m 1024 \
  -display none -vga none -nodefaults -no-user-config -no-reboot -monitor none -serial file:"$folder/console.log" \
  -kernel "$kernel/vmlinux" -initrd "$kernel/initrd.gz" \
  -append "console=ttyS0 quiet panic=-1 mitigations=off nilio_run=$folder/command.sh" \
  -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap -device virtio-9p-pci,fsdev=host,mount_tag=host \
  -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus </dev/null || status=$?
tr -d '\r' <"$folder/console.log"
result=$(sed -n 's/.*nilio-guest-status=\([0-9]*\).*/\1/p' "$folder/console.log" | tail -1)
[[ -n $result ]] || { echo "run_tier3: the guest ended without a result (status $status; 124 = out of time)"; exit 1; }
exit "$result"
