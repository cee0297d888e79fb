#!/bin/sh
# First process of the user-mode-linux guest, whose root is this computer's, read-only. Not busybox sh, which starts itself by
# /proc/self/exe, the kernel in this case.
PATH=/usr/sbin:/usr/bin:/sbin:/bin
HOME=/root
export PATH HOME

finish() {
  echo "nilio-guest-status=$1"
  busybox poweroff -f
}

mount -t proc proc /proc
run=$(sed 's/.*nilio_run=\([^ ]*\).*/\1/' /proc/cmdline)
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan drivers/net/can/slcan/slcan \
  fs/overlayfs/overlay; do
  busybox insmod "$modules/$module.ko" || finish 97
done

# An overlay in memory protects the computer's files from writes.
mount -t tmpfs -o size=50% tmpfs /mnt
mkdir /mnt/upper /mnt/work /mnt/root
mount -t overlay -o lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work overlay /mnt/root || finish 97
root=/mnt/root
mount -t proc proc $root/proc
mount -t sysfs sys $root/sys
mount -t devtmpfs dev $root/dev 2>/dev/null
mkdir -p $root/dev/pts $root/dev/shm
mount -t devpts -o ptmxmode=666 devpts $root/dev/pts
mount -t tmpfs tmpfs $root/dev/shm
mount -t tmpfs tmpfs $root/run
busybox ip link set lo up
chroot $root "$run"
finish $?
