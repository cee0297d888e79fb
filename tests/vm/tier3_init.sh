#!/bin/busybox sh
# First process of the QEMU guest: its root becomes this computer's files, read-only, with an overlay in memory. Runs the command
# nilio_run=FILE there, or systemd with the units of nilio_units=FOLDER instead of the computer's own.
export PATH=/bin:/usr/sbin:/usr/bin:/sbin HOME=/root
b=/bin/busybox

finish() {
  $b echo "nilio-guest-status=$1"
  $b poweroff -f
}

argument() { $b sed -n "s/.*$1=\([^ ]*\).*/\1/p" "$2"; }

$b mount -t proc proc /proc
$b mount -t sysfs sys /sys
$b mount -t devtmpfs dev /dev
while read -r module; do
  $b insmod "/modules/$module" || finish 97
done </modules/order
$b mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,ro,cache=loose host /host || finish 97
$b mount -t tmpfs -o size=50% tmpfs /memory
$b mkdir /memory/upper /memory/work
$b mount -t overlay -o lowerdir=/host,upperdir=/memory/upper,workdir=/memory/work overlay /root || finish 97
for folder in proc sys dev; do $b mount --move /$folder /root/$folder; done
$b ip link set lo up

units=$(argument nilio_units /root/proc/cmdline)
if [ -n "$units" ]; then
  $b rm -rf /root/etc/systemd/system
  $b cp -a "/root$units" /root/etc/systemd/system || finish 97
  $b printf '' >/root/etc/fstab
  # Files that the guest writes, for tests.
  $b mkdir -p /root/memory
  $b mount --bind /memory/upper /root/memory || finish 97
  exec $b switch_root /root /lib/systemd/systemd --unit=nilio-test.target --show-status=0 --log-level=warning
fi

$b mkdir -p /root/dev/pts /root/dev/shm
$b mount -t devpts -o ptmxmode=666 devpts /root/dev/pts
$b mount -t tmpfs tmpfs /root/dev/shm
$b mount -t tmpfs tmpfs /root/run
$b chroot /root "$(argument nilio_run /root/proc/cmdline)"
finish $?
