#!/usr/bin/env bash
# Packs the Debian packages of a build, and installs, uses, upgrades and purges them in a fresh Debian root file system.
#   test_package.sh BUILD_FOLDER
# build/package of the sources keeps the root file system and the downloaded dependencies; exit status 77 = skipped
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
build=$(realpath "$1")
cache=$source_dir/build/package
mkdir -p "$cache"
work=$build/package
root=$work/root
export LC_ALL=C.UTF-8 PATH=$PATH:/usr/sbin:/sbin

skip() { echo "skipped: package: $1"; exit 77; }
fail() { echo "package: $1" >&2; exit 1; }
step() { printf '%4d s  %s\n' $SECONDS "$1"; }

((EUID == 0)) || skip "chroot wants root"
for program in mmdebstrap:mmdebstrap lintian:lintian dpkg-deb:dpkg strip:binutils; do
  command -v "${program%%:*}" >/dev/null || skip "${program#*:} is not installed; tools/setup.sh --tests installs it"
done
if [[ ! -s $cache/base.tar ]]; then
  mmdebstrap --quiet --variant=minbase --skip=cleanup/apt/lists bookworm "$cache/new.tar" "${NILIO_DEBIAN_MIRROR:-http://deb.debian.org/debian}" \
    2>"$cache/mmdebstrap.log" || skip "no root file system: $(tail -1 "$cache/mmdebstrap.log")"
  mv "$cache/new.tar" "$cache/base.tar"
  step "made a root file system: $(du -h "$cache/base.tar" | cut -f1)"
fi

rm -rf "$work"
mkdir -p "$work/debs" "$root" "$cache/archives/partial"
cpack --config "$build/CPackConfig.cmake" -B "$work/debs" >"$work/cpack.txt" 2>&1 || { cat "$work/cpack.txt" >&2; fail "cpack failed"; }
nilio_deb=$(echo "$work"/debs/nilio_*.deb)
dev_deb=$(echo "$work"/debs/libnilio-dev_*.deb)
step "packed $(du -h "$nilio_deb" "$dev_deb" | awk '{ n = split($2, p, "/"); printf "%s %s  ", p[n], $1 }')"
lintian --allow-root --fail-on error --tag-display-limit 0 "$nilio_deb" "$dev_deb" >"$work/lintian.txt" 2>&1 ||
  { cat "$work/lintian.txt" >&2; fail "lintian finds errors"; }
step "lintian: no errors, $(grep -c '^W:' "$work/lintian.txt" || true) warnings"

tar -xf "$cache/base.tar" -C "$root"
cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
# in_root COMMAND...: in the root file system, with mounts that end with the command.
in_root() {
  unshare --mount --propagation private bash -c '
    mount -t proc proc "$0/proc"; mount -t tmpfs tmpfs "$0/dev/shm"; mount --bind "$1" "$0/var/cache/apt/archives"
    root=$0; shift; exec chroot "$root" "$@"' "$root" "$cache/archives" env DEBIAN_FRONTEND=noninteractive "$@"
}
apt() { in_root apt-get -q -y -o APT::Sandbox::User=root -o Dpkg::Use-Pty=0 "$@" >>"$work/apt.txt" 2>&1; }
# Files, modes, owners and links, and the contents of /etc; without the notes of apt and dpkg about themselves.
snapshot() {
  (cd "$root" && find . -xdev \( -path ./proc -o -path ./dev -o -path ./tmp -o -path ./var/lib/dpkg -o -path ./var/lib/apt -o -path ./var/cache \
    -o -path ./var/log -o -name '*-' -path './etc/*' \) -prune -o -printf '%P %y %m %U:%G %l\n' | sort
  find "$root/etc" -type f ! -name '*-' -exec sha256sum {} + | sort -k2)
}
install_deb() { cp "$1" "$root/tmp/package.deb"; apt "${@:2}" install /tmp/package.deb || { tail -20 "$work/apt.txt" >&2; fail "apt cannot install $1"; }; }

# The dependencies first, so that what nilio itself leaves can be told.
cp "$nilio_deb" "$root/tmp/nilio.deb"
dependencies() { in_root apt-get -s install /tmp/nilio.deb 2>>"$work/apt.txt" | awk '$1 == "Inst" && $2 != "nilio" { print $2 }'; }
missing=$(dependencies) || { apt update || skip "no Debian mirror: $(tail -1 "$work/apt.txt")"; missing=$(dependencies); }
[[ $missing == *systemd* && $missing == *fastrtps* ]] || fail "unexpected dependencies: $missing"
# shellcheck disable=SC2086
apt install $missing || { apt update && apt install $missing; } || skip "no Debian mirror: $(tail -1 "$work/apt.txt")"
step "installed $(wc -w <<<"$missing") dependencies"
snapshot >"$work/before.txt"

install_deb "$nilio_deb"
step "installed nilio"
for file in usr/bin/niliod usr/bin/nilio-publisher usr/bin/nilio-mapper usr/bin/nilio etc/nilio/vehicle.yaml usr/share/nilio/dbc/xsens_mti.dbc \
  usr/lib/systemd/system/niliod.service usr/lib/systemd/system/niliod@.service usr/lib/sysusers.d/nilio.conf usr/lib/sysctl.d/90-nilio.conf \
  usr/share/man/man8/niliod.8.gz usr/share/man/man8/nilio-publisher.8.gz usr/share/man/man1/nilio.1.gz usr/share/doc/nilio/copyright \
  usr/share/bash-completion/completions/nilio usr/share/bash-completion/completions/niliod; do
  [[ -e $root/$file ]] || fail "$file is not installed"
done
grep -q '^nilio:.*:/usr/sbin/nologin$' "$root/etc/passwd" || fail "no system user nilio"
enabled=$root/etc/systemd/system/multi-user.target.wants/niliod.service
[[ ! -L $enabled ]] || fail "the installation enabled niliod.service"
grep -q '^ExecStart=/usr/bin/niliod' "$root/usr/lib/systemd/system/niliod.service" || fail "niliod.service does not start /usr/bin/niliod"
in_root /usr/bin/niliod --config /etc/nilio/vehicle.yaml --check-config >"$work/config.yaml" || fail "niliod refuses vehicle.yaml"

# A drive: the same bits as from the build tree.
"$build/bin/nilio" simulate "$work/drive" --sensor vlp16 --duration 40 >"$work/simulate.txt"
step "simulated a drive"
settings=(--set publisher.domain=87 --set 'publisher.interfaces=["127.0.0.1"]')
"$build/bin/niliod" --replay "$work/drive" --output "$work/run" "${settings[@]}" >"$work/run.txt" 2>&1
cp -r "$work/drive" "$root/tmp/drive"
chmod -R a+rX "$root/tmp/drive"
in_root runuser -u nobody -- niliod --replay /tmp/drive --output /tmp/run "${settings[@]}" >"$work/run_in_root.txt" 2>&1 ||
  { tail -5 "$work/run_in_root.txt" >&2; fail "niliod fails in the root file system"; }
expected=$(sha256sum <"$work/run/trajectory.tum")
[[ $(wc -l <"$work/run/trajectory.tum") -gt 300 ]] || fail "the drive has too few poses"
[[ $(sha256sum <"$root/tmp/run/trajectory.tum") == "$expected" ]] || fail "other poses than those of the build tree"
step "drive: $(wc -l <"$work/run/trajectory.tum") poses, SHA-256 ${expected:0:16}, as in the build tree"
in_root nilio evaluate /tmp/drive/truth.tum /tmp/run/trajectory.tum >"$work/evaluation.txt" || fail "nilio evaluate fails"
rm -rf "$root/tmp/drive" "$root/tmp/run"

# An upgrade whose package has another vehicle.yaml: the owner's stays.
echo '# edited by the owner' >>"$root/etc/nilio/vehicle.yaml"
edited=$(sha256sum <"$root/etc/nilio/vehicle.yaml")
dpkg-deb -R "$nilio_deb" "$work/next"
sed -i 's/^Version: .*/&+next1/' "$work/next/DEBIAN/control"
echo '# changed by the package' >>"$work/next/etc/nilio/vehicle.yaml"
dpkg-deb --root-owner-group -Znone --build "$work/next" "$work/debs/next.deb" >/dev/null
in_root systemctl --quiet enable niliod.service niliod@truck.service nilio-can@can0.service
install_deb "$work/debs/next.deb" -o Dpkg::Options::=--force-confdef
[[ $(in_root dpkg-query -W -f '${Version}' nilio) == *+next1 ]] || fail "the upgrade did not happen"
[[ $(sha256sum <"$root/etc/nilio/vehicle.yaml") == "$edited" ]] || fail "the upgrade replaced an edited vehicle.yaml"
[[ -L $enabled ]] || fail "the upgrade disabled niliod.service"
step "upgrade kept the edited vehicle.yaml and the enabled service"

# A removed package keeps configuration and state, a purged one nothing.
mkdir -p "$root/var/lib/nilio/truck"
echo 'lidar: {port: 2369}' >"$root/etc/nilio/truck.yaml"
echo pose >"$root/var/lib/nilio/truck/state"
apt remove nilio || fail "apt cannot remove nilio"
[[ -e $root/etc/nilio/vehicle.yaml && -e $root/var/lib/nilio/truck/state ]] || fail "remove deleted configuration or state"
apt purge nilio || fail "apt cannot purge nilio"
snapshot >"$work/after.txt"
diff "$work/before.txt" "$work/after.txt" >"$work/left.txt" || { cat "$work/left.txt" >&2; fail "purge leaves or changes files (< before, > after)"; }
step "purge left nothing"

# The development package: dependencies that Debian has, and an example that builds with it.
cp "$dev_deb" "$root/tmp/package.deb"
in_root apt-get -s install /tmp/package.deb >"$work/dev.txt" 2>&1 || { tail -5 "$work/dev.txt" >&2; fail "libnilio-dev: unknown dependencies"; }
dpkg-deb -x "$dev_deb" "$work/dev"
# The user's instruction set need not be the library's.
flags=
grep -qw avx2 /proc/cpuinfo && flags=-march=x86-64-v3
cmake -S "$work/dev/usr/share/doc/libnilio-dev/examples" -B "$work/examples" -DCMAKE_PREFIX_PATH="$work/dev/usr" -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_CXX_FLAGS="$flags" >"$work/configure.txt"
cmake --build "$work/examples" >"$work/build.txt"
"$work/examples/odometry_from_pcap" "$work/drive/lidar.pcap" >"$work/poses.txt"
[[ $(wc -l <"$work/poses.txt") -gt 300 ]] || fail "the example with libnilio-dev computes too few poses"
step "example built with libnilio-dev and '$flags': $(wc -l <"$work/poses.txt") poses"
rm -rf "$root" "$work/next" "$work/drive"
