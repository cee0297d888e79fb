#!/usr/bin/env bash
# Compares the trajectories of niliod bit by bit between instruction sets: as built, and with AVX2 and FMA hidden from libm.
#   test_same_bits.sh BUILD_FOLDER          a simulated drive of 20 s
#   test_same_bits.sh BUILD_FOLDER --long   3.7 km along KITTI's sequence 00 with a VLP-16, also with builds for x86-64 and
#                                           x86-64-v2; needs NILIO_DATA and a while; short drives miss rare bits
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
build=$(realpath "$1")
work=$build/same_bits
programs=("$build/bin/niliod")
mkdir -p "$work"

# These names are those of glibc 2.36; others are ignored without a message.
hidden=GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4
bits_of_libm='import math, hashlib
print(hashlib.sha256(b"".join(math.sin(i / 997).hex().encode() for i in range(200000))).hexdigest())'
if [[ $(python3 -c "$bits_of_libm") == $(env "$hidden" python3 -c "$bits_of_libm") ]]; then
  echo "skipped: same_bits: hiding AVX2 and FMA changes nothing on this computer"
  exit 77
fi

if [[ ${2:-} == --long ]]; then
  poses=${NILIO_DATA:-$source_dir/../shared/data}/kitti/odometry_poses_00-10.tar.xz
  [[ -e $poses ]] || { echo "skipped: same_bits --long: no $poses"; exit 77; }
  drive=$work/kitti_00
  if [[ ! -e $drive/nilio.yaml ]]; then
    tar -xJf "$poses" -C "$work"
    "$build/bin/nilio" simulate "$drive" --sensor vlp16 --trajectory "$(find "$work" -name 00.txt | head -1)"
  fi
  for baseline in x86-64 x86-64-v2; do
    cmake -S "$source_dir" -B "$work/$baseline" -G Ninja -DCMAKE_BUILD_TYPE=Release -DNILIO_BASELINE=$baseline -DNILIO_FAST_BUILD=ON \
      -DBUILD_TESTING=OFF >"$work/configure.txt"
    cmake --build "$work/$baseline" --target niliod >"$work/build.txt"
    programs+=("$work/$baseline/bin/niliod")
  done
else
  drive=$work/short
  "$build/bin/nilio" simulate "$drive" --sensor vlp16 --duration 20 >"$work/simulate.txt"
fi

settings=(--set publisher.enabled=false)
sums=()
for program in "${programs[@]}"; do
  for environment in LC_ALL=C "$hidden"; do
    # A replay that loses tracking ends with 3; its poses count all the same.
    env "$environment" "$program" --replay "$drive" --output "$work/run" --force "${settings[@]}" >"$work/run.txt" 2>&1 || (($? == 3))
    sum=$(sha256sum <"$work/run/trajectory.tum" | cut -d' ' -f1)
    echo "$sum  $(wc -l <"$work/run/trajectory.tum") poses  ${program#"$build"/}  ${environment/LC_ALL=C/all of the processor}"
    sums+=("$sum")
  done
done
[[ $(printf '%s\n' "${sums[@]}" | sort -u | wc -l) == 1 ]] || { echo "same_bits: trajectories differ" >&2; exit 1; }
