#!/usr/bin/env bash
# Installs the Debian 12 packages for building nilio; may be repeated.
# "setup.sh --tests" adds those of tests and checks.
set -euo pipefail

packages=(
  build-essential cmake ninja-build pkg-config git ca-certificates
  libeigen3-dev libtbb-dev libsleef-dev libspdlog-dev libyaml-cpp-dev libcli11-dev nlohmann-json3-dev
  libpcap-dev libpugixml-dev libsocketcan-dev libsqlite3-dev libzstd-dev liblz4-dev libbz2-dev zlib1g-dev libfastrtps-dev libfastcdr-dev
  libembree-dev libcairo2-dev libssl-dev libwebsockets-dev
)
# The page of nilio view; any node and npm will do, those of Debian bring some hundred packages.
command -v npm >/dev/null || packages+=(nodejs npm)
if [[ ${1:-} == --tests ]]; then
  packages+=(catch2 ccache cyclonedds-dev cyclonedds-tools python3 python3-numpy python3-jsonschema python3-open3d python3-yaml python3-rosbag sqlite3 chromium prometheus xz-utils procps clang-format-14 clang-tidy-14
    clang-14 libclang-rt-14-dev
    mmdebstrap lintian groff-base
    user-mode-linux busybox-static qemu-system-x86 cpio kmod libelf1 systemd)
fi

# A full disk ends builds and tests in the middle, with a message of whatever wrote last.
check_disk() {
  local needed_mib=3000
  [[ ${1:-} == --tests ]] && needed_mib=6500
  local folder there_mib=0 free_mib
  folder=$(cd "$(dirname "$0")/.." && pwd)
  [[ ! -d $folder/build ]] || there_mib=$(du --summarize --block-size=1M "$folder/build" | cut --fields=1)
  free_mib=$(df --block-size=1M --output=avail "$folder" | tail -n 1)
  if ((free_mib + there_mib < needed_mib)); then
    echo "setup: the disk of $folder has ${free_mib// /} MiB free, builds and tests need $((needed_mib - there_mib)) more: make room" >&2
    exit 1
  fi
}
check_disk "$@"

# The kernel of tests/vm is only unpacked, not installed; without it those tests are skipped.
finish() {
  [[ ${1:-} == --tests ]] || return 0
  "$(dirname "$0")/../tests/vm/tier3_prepare.sh" "$(dirname "$0")/../build/vm" ||
    echo "setup: tier 3 of tests/vm has no kernel, and says so instead of testing; see above" >&2
}

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
  [[ $status == installed ]] || missing+=("$package")
done
if ((${#missing[@]} == 0)); then
  echo "setup: all packages are installed"
  finish "$@"
  exit 0
fi

as_root=()
if ((EUID != 0)); then
  command -v sudo >/dev/null || { echo "setup: run as root, or install sudo; missing: ${missing[*]}" >&2; exit 1; }
  as_root=(sudo)
fi
echo "setup: installing ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -q
"${as_root[@]}" apt-get install -q -y --no-install-recommends "${missing[@]}"
finish "$@"
