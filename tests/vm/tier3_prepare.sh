#!/usr/bin/env bash
# Makes what tier 3 boots from Debian's packages: the kernel, a first file system with the CAN drivers, and the module that
# injects controller states. Quick when all is there.
#   tier3_prepare.sh FOLDER        writes FOLDER/{vmlinux,initrd.gz,can_inject.ko,release}
set -euo pipefail
here=$(dirname "$(realpath "$0")")
mkdir -p "$1"
cd "$1"

# From two builds at once, the second waits.
exec 9>lock
flock 9

image=$(ls linux-image-*_amd64.deb 2>/dev/null | sort --version-sort | tail -1)
if [[ -z $image ]]; then
  package=$(apt-cache depends linux-image-amd64 | sed -n 's/.*Depends: \(linux-image-[0-9].*\)/\1/p' | head -1)
  [[ -n $package ]] || { echo "tier3_prepare: apt knows no linux-image-amd64; run apt-get update" >&2; exit 1; }
  release=${package#linux-image-}
  abi=${release%-amd64}
  apt-get download -q "$package" "linux-headers-$release" "linux-headers-$abi-common" \
    "$(apt-cache depends "linux-headers-$release" | sed -n 's/.*Depends: \(linux-kbuild-.*\)/\1/p' | head -1)" >&2
  image=$(ls linux-image-*_amd64.deb | sort --version-sort | tail -1)
fi
release=${image#linux-image-}
release=${release%%_*}
if [[ $(cat release 2>/dev/null) == "$release" && -s vmlinux && -s initrd.gz && can_inject.ko -nt "$here/can_inject.c" &&
  initrd.gz -nt "$here/tier3_init.sh" ]]; then
  exit 0
fi
rm -f release

if [[ ! -d root ]]; then
  mkdir -p root.new
  for package in linux-headers-*.deb linux-kbuild-*.deb; do dpkg-deb --extract "$package" root.new; done
  # Of the image only what is booted: unpacked it has 400 MB.
  dpkg-deb --fsys-tarfile "$image" | tar --extract --directory root.new --wildcards './boot/vmlinuz*' \
    './lib/modules/*/modules.*' './lib/modules/*/kernel/net/can' './lib/modules/*/kernel/drivers/net/can' \
    './lib/modules/*/kernel/fs/*' './lib/modules/*/kernel/net/9p' './lib/modules/*/kernel/drivers/virtio' \
    './lib/modules/*/kernel/drivers/net/phy' './lib/modules/*/kernel/drivers/char/hw_random'
  sed -i "s|include /usr|include $PWD/root/usr|" "root.new/usr/src/linux-headers-$release/Makefile"
  mv root.new root
fi

# Uncompressed, the kernel boots some seconds sooner where the processor is emulated.
if [[ ! -s vmlinux ]]; then
  for offset in $(LC_ALL=C grep --only-matching --byte-offset --text --perl-regexp '\xfd7zXZ\x00' "root/boot/vmlinuz-$release" |
    cut -d: -f1); do
    tail --bytes=+$((offset + 1)) "root/boot/vmlinuz-$release" | xz --decompress --single-stream --quiet >vmlinux.new 2>/dev/null || true
    [[ $(head --bytes=4 vmlinux.new | tail --bytes=3) == ELF ]] && mv vmlinux.new vmlinux && break
  done
  [[ -s vmlinux ]] || { echo "tier3_prepare: no kernel found in root/boot/vmlinuz-$release" >&2; exit 1; }
fi

/sbin/depmod --basedir "$PWD/root" "$release"
first=$(mktemp --directory)
trap 'rm -rf "$first"' EXIT
mkdir -p "$first"/{bin,dev,proc,sys,modules,host,memory,root}
cp /bin/busybox "$first/bin/"
cp "$here/tier3_init.sh" "$first/init"
for module in virtio_pci 9p 9pnet_virtio overlay can-raw vcan slcan kvaser_pci; do
  /sbin/modprobe --dirname "$PWD/root" --set-version "$release" --show-depends "$module" | sed -n 's/^insmod \([^ ]*\).*/\1/p'
done | awk '!seen[$0]++' >modules.list
[[ $(wc -l <modules.list) -gt 8 ]] || { echo "tier3_prepare: the modules' dependencies are not known" >&2; exit 1; }
while read -r module; do
  cp "$module" "$first/modules/"
  basename "$module" >>"$first/modules/order"
done <modules.list
(cd "$first" && find . | cpio --create --format=newc --quiet | gzip -1) >initrd.gz

mkdir -p inject
cp "$here/can_inject.c" inject/
echo 'obj-m := can_inject.o' >inject/Makefile
make --silent --directory="root/usr/src/linux-headers-$release" M="$PWD/inject" modules >&2
cp inject/can_inject.ko "$(grep kvaser_pci modules.list)" .
echo "$release" >release
