#!/usr/bin/env bash
# Makes the boot files of tier 3 from Debian's packages: the kernel, an initial file system with the CAN drivers, and the
# module that injects controller states. Installs no package. Quick when the files exist.
#   tier3_prepare.sh [--offline] FOLDER     writes FOLDER/{vmlinux,initrd.gz,can_inject.ko,kvaser_pci.ko,made}
# --offline uses packages that were fetched before. Exit status: 77 = not available, with a line that gives the reason
set -euo pipefail
here=$(dirname "$(realpath "$0")")
# shellcheck source=guest.sh
source "$here/guest.sh"
offline=0
[[ ${1:-} == --offline ]] && { offline=1; shift; }
export PATH=$PATH:/usr/sbin:/sbin LC_ALL=C
mkdir -p "$1"
cd "$1"

newest_image() { find . -maxdepth 1 -name 'linux-image-*_amd64.deb' | sort --version-sort | tail -1; }

# Version stamp of the inputs.
ingredients() { echo "$(newest_image) $(cat "$here/can_inject.c" "$here/tier3_init.sh" "$here/tier3_prepare.sh" | sha256sum)"; }

is_made() { [[ -s vmlinux && -s initrd.gz && -s can_inject.ko && $(cat made 2>/dev/null) == "$(ingredients)" ]]; }

is_made && exit 0
[[ -w . ]] || { echo "skipped: $PWD is not up to date and of another user; tools/setup.sh --tests as that user makes it"; exit "$kSkipped"; }
# Of two concurrent builds the second waits.
exec 9>lock
flock 9
is_made && exit 0

# Dependencies of package $1 that match $2.
dependency() { apt-cache depends "$1" 2>/dev/null | sed -n "s/.*Depends: \($2\)\$/\1/p" | tail -1; }

fetch() {
  local image headers kbuild
  image=$(dependency linux-image-amd64 'linux-image-[0-9].*')
  headers=${image/image/headers}
  kbuild=$(dependency "$headers" 'linux-kbuild-.*')
  [[ -n $image && -n $kbuild ]] || return
  rm -rf fetched
  mkdir fetched
  # Rename complete downloads only.
  (cd fetched && apt-get -o APT::Sandbox::User=root download -q "$image" "$headers" "${headers%-amd64}-common" "$kbuild") >&2 || return
  mv fetched/*.deb .
  rmdir fetched
}

# Package lists are missing in fresh containers, and outdated ones name removed packages.
refresh_lists() {
  if ((EUID == 0)); then
    apt-get update -q >&2
  else
    sudo --non-interactive apt-get update -q >&2
  fi
}

image=$(newest_image)
if [[ -z $image ]]; then
  ((offline == 0)) || { echo "skipped: the kernel is not in $PWD; tools/setup.sh --tests fetches it"; exit "$kSkipped"; }
  need apt-get:apt
  fetch || { refresh_lists && fetch; } ||
    { echo "skipped: apt cannot fetch linux-image-amd64, its headers and linux-kbuild; see above"; exit "$kSkipped"; }
  image=$(newest_image)
fi
release=${image#./linux-image-}
release=${release%%_*}

need dpkg-deb:dpkg xz:xz-utils cpio:cpio depmod:kmod modprobe:kmod make:build-essential gcc-12:build-essential
# A busybox that needs libraries would not start in the first file system.
[[ -x /bin/busybox ]] && ! ldd /bin/busybox >/dev/null 2>&1 || need busybox-static:busybox-static

rm -rf made work
mkdir -p work/root work/first/{bin,dev,proc,sys,modules,host,memory,root} work/inject
work=$PWD/work
root=$work/root
trap 'rm -rf "$work"' EXIT
for package in linux-headers-*.deb linux-kbuild-*.deb; do dpkg-deb --extract "$package" "$root"; done
# Unpack only the booted files: the whole image has 400 MB.
dpkg-deb --fsys-tarfile "$image" | tar --extract --directory "$root" --wildcards './boot/vmlinuz*' \
  './lib/modules/*/modules.*' './lib/modules/*/kernel/net/can' './lib/modules/*/kernel/drivers/net/can' \
  './lib/modules/*/kernel/fs/*' './lib/modules/*/kernel/net/9p' './lib/modules/*/kernel/drivers/virtio' \
  './lib/modules/*/kernel/drivers/net/phy' './lib/modules/*/kernel/drivers/char/hw_random'
sed -i "s|include /usr|include $root/usr|" "$root/usr/src/linux-headers-$release/Makefile"

# An uncompressed kernel boots some seconds sooner on an emulated processor.
compressed=$root/boot/vmlinuz-$release
for offset in $(grep --only-matching --byte-offset --text --perl-regexp '\xfd7zXZ\x00' "$compressed" | cut -d: -f1); do
  tail --bytes=+$((offset + 1)) "$compressed" | xz --decompress --single-stream --quiet >work/vmlinux 2>/dev/null || true
  [[ $(head --bytes=4 work/vmlinux | tail --bytes=3) == ELF ]] && break
done
[[ $(head --bytes=4 work/vmlinux | tail --bytes=3) == ELF ]] ||
  { echo "tier3_prepare: no kernel found in $image; remove $PWD to fetch it anew" >&2; exit 1; }

depmod --basedir "$root" "$release"
cp /bin/busybox work/first/bin/
cp "$here/tier3_init.sh" work/first/init
for module in virtio_pci 9p 9pnet_virtio overlay can-raw vcan slcan kvaser_pci; do
  modprobe --dirname "$root" --set-version "$release" --show-depends "$module" | sed -n 's/^insmod \([^ ]*\).*/\1/p'
done | awk '!seen[$0]++' >work/modules
[[ $(wc -l <work/modules) -gt 8 ]] || { echo "tier3_prepare: the modules' dependencies are not known" >&2; exit 1; }
while read -r module; do
  cp "$module" work/first/modules/
  basename "$module" >>work/first/modules/order
done <work/modules
(cd work/first && find . | cpio --create --format=newc --quiet | gzip -1) >work/initrd.gz

cp "$here/can_inject.c" work/inject/
echo 'obj-m := can_inject.o' >work/inject/Makefile
make --silent --directory="$root/usr/src/linux-headers-$release" M="$work/inject" modules >&2
mv work/{vmlinux,initrd.gz} work/inject/can_inject.ko "$(grep kvaser_pci work/modules)" .
ingredients >made
