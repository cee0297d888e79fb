# Shared functions of the scripts of both tiers; sourced.

# Exit status that ctest reports as "skipped".
readonly kSkipped=77
# Time limit of a guest, s.
readonly kGuestLimit=${VM_TIMEOUT:-1500}

# need PROGRAM:PACKAGE...: exits with a line that names the missing packages.
need() {
  local entry missing=()
  for entry in "$@"; do
    command -v "${entry%%:*}" >/dev/null || missing+=("${entry#*:}")
  done
  ((${#missing[@]} == 0)) && return
  echo "skipped: packages not installed: ${missing[*]}; tools/setup.sh --tests installs them"
  exit "$kSkipped"
}

# prepare_debian_guest FOLDER KERNEL [PROGRAM:PACKAGE...]: sets `folder` and `kernel` of a guest with Debian's own kernel, or skips.
prepare_debian_guest() {
  folder=$(realpath -m "$1")
  kernel=$(realpath -m "$2")
  shift 2
  need qemu-system-x86_64:qemu-system-x86 "$@"
  "$(dirname "${BASH_SOURCE[0]}")/tier3_prepare.sh" --offline "$kernel"
  mkdir -p "$folder"
}

# write_command FOLDER ASSIGNMENT COMMAND [ARGUMENT...]: writes the command for the guest's first process.
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

# run_guest FOLDER PROGRAM [ARGUMENT...]: runs the guest to its end, with the console in FOLDER/console.log.
run_guest() {
  local folder=$1
  shift
  guest_status=0
  # Remove the previous result, in case the guest does not start.
  : >"$folder/console.log"
  local TIMEFORMAT='%R %U %S'
  # One thread emulates the guest: it waits for no compilers or tests where this user may say so.
  { time nice --adjustment=-5 timeout -k 5 "$kGuestLimit" "$@" </dev/null >"$folder/program.log" 2>&1 || guest_status=$?; } 2>"$folder/times"
}

# Devices of a machine with two emulated PCI CAN controllers on one bus.
readonly kCanControllers=(-object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus)

# boot_debian_kernel FOLDER KERNEL START [ARGUMENT...]: run_guest with Debian's own kernel, of tier3_prepare.sh, in QEMU. START: what
# tier3_init.sh starts; the arguments add devices to the machine.
boot_debian_kernel() {
  local folder=$1 kernel=$2 start=$3
  shift 3
  # The processor is emulated even with KVM: fast enough, and the same on every machine. One processor: with two, a
  # burst overruns the emulated controller's buffer. Its instructions are those of the build: with wider vectors glibc chooses functions
  # that take nearly twice as long to emulate.
  run_guest "$folder" qemu-system-x86_64 -M q35 -accel tcg,thread=multi -cpu Nehalem -smp 1 -m 1024 \
    -display none -vga none -nodefaults -no-user-config -no-reboot -monitor none -serial file:"$folder/console.log" \
    -kernel "$kernel/vmlinux" -initrd "$kernel/initrd.gz" \
    -append "console=ttyS0 quiet panic=-1 mitigations=off no_timer_check $start" \
    -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap -device virtio-9p-pci,fsdev=host,mount_tag=host "$@"
}

# end_as_guest FOLDER: exits with the status of the guest's command, read from the console. A guest without a status may have
# hung or starved: the run fails, with a line on the processor time of the guest.
end_as_guest() {
  local folder=$1 result wall user system
  read -r wall user system < <(tail -1 "$folder/times")
  tr -d '\r' <"$folder/console.log"
  echo "guest: $wall s, of them $user s + $system s of processor time; load average $(cut -d' ' -f1-3 /proc/loadavg)"
  result=$(sed -n 's/.*nilio-guest-status=\([0-9]*\).*/\1/p' "$folder/console.log" | tail -1)
  # Undecided checks of a starved guest do not count as passed.
  [[ $result == 0 ]] && grep --quiet '^undecided:' "$folder/console.log" && exit "$kSkipped"
  [[ -n $result ]] && exit "$result"
  tail -5 "$folder/program.log"
  if ((guest_status == 124)); then
    echo "failed: the guest was not done after $kGuestLimit s; run it again on a quieter machine, or with a larger VM_TIMEOUT (s)"
  else
    echo "failed: the guest ended without a result, with status $guest_status; see $folder"
  fi
  exit 1
}
