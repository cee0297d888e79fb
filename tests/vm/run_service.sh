#!/usr/bin/env bash
# Runs a command as a service of systemd, process 1 of a guest with Debian's own kernel in QEMU and two emulated PCI CAN controllers on
# one bus. Needs neither root nor hardware virtualisation. The guest sees this computer's files; its writes are discarded.
#   NILIO_BUILD=BUILD run_service.sh FOLDER KERNEL COMMAND [ARGUMENT...]    KERNEL: folder of tier3_prepare.sh, shared by builds
# FOLDER takes units and the guest's console; exit status: the command's, 77 = skipped
set -euo pipefail
here=$(dirname "$(realpath "$0")")
# shellcheck source=guest.sh
source "$here/guest.sh"
prepare_debian_guest "$1" "$2" systemctl:systemd
shift 2
rm -rf "$folder/units"
mkdir -p "$folder/units/nilio-test.target.wants"

# The package, or its files where the build makes none.
rm -rf "$folder/package" "$folder/stage"
if [[ -e $NILIO_BUILD/CPackConfig.cmake ]]; then
  cpack --config "$NILIO_BUILD/CPackConfig.cmake" -B "$folder/package" -D CPACK_COMPONENTS_ALL=runtime -D CPACK_DEBIAN_COMPRESSION_TYPE=gzip \
    >"$folder/package.log" 2>&1 || { tail -5 "$folder/package.log"; echo "failed: cpack makes no package"; exit 1; }
  what="NILIO_PACKAGE='$(echo "$folder"/package/nilio_*.deb)'"
else
  DESTDIR=$folder/stage cmake --install "$NILIO_BUILD" --prefix /usr --component runtime --strip >/dev/null
  lib=$folder/stage/usr/lib
  install -D -m 644 --target-directory="$lib/systemd/system" "$here"/../../systemd/*.service
  install -D -m 644 "$here/../../systemd/nilio.sysusers" "$lib/sysusers.d/nilio.conf"
  install -D -m 644 "$here/../../systemd/nilio.tmpfiles" "$lib/tmpfiles.d/nilio.conf"
  install -D -m 644 --target-directory="$lib/sysctl.d" "$here/../../systemd/90-nilio.conf"
  what="NILIO_STAGE='$folder/stage'"
fi
write_command "$folder" "NILIO_KERNEL='$kernel' $what" "$@"

cd "$folder/units"
cat >nilio-test.target <<'UNIT'
[Unit]
Requires=sysinit.target
After=sysinit.target
AllowIsolate=yes
UNIT
cat >nilio-test.service <<UNIT
[Unit]
After=sysinit.target
DefaultDependencies=no
SuccessAction=poweroff-force
FailureAction=poweroff-force

[Service]
Type=oneshot
ExecStart=/bin/sh -c '$folder/command.sh; echo nilio-guest-status=\$\$?'
StandardOutput=tty
StandardError=inherit
TTYPath=/dev/ttyS0
UNIT
ln -s ../nilio-test.service nilio-test.target.wants/
# Slow on an emulated processor, and of no use here.
for unit in systemd-tmpfiles-setup systemd-tmpfiles-setup-dev systemd-binfmt systemd-sysusers systemd-update-utmp systemd-random-seed \
  systemd-modules-load systemd-remount-fs systemd-journal-flush systemd-machine-id-commit systemd-pstore kmod-static-nodes \
  systemd-udevd systemd-udev-trigger modprobe@; do
  ln -s /dev/null "$unit.service"
done
for unit in proc-sys-fs-binfmt_misc.automount proc-sys-fs-binfmt_misc.mount sys-kernel-debug.mount sys-kernel-tracing.mount \
  sys-kernel-config.mount sys-fs-fuse-connections.mount dev-hugepages.mount dev-mqueue.mount systemd-ask-password-console.path \
  systemd-ask-password-wall.path systemd-initctl.socket systemd-journald-audit.socket cryptsetup.target integritysetup.target \
  veritysetup.target swap.target getty.target; do
  ln -s /dev/null "$unit"
done

boot_debian_kernel "$folder" "$kernel" "nilio_units=$folder/units" "${kCanControllers[@]}"
end_as_guest "$folder"
