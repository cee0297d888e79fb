#!/usr/bin/env bash
# Builds the examples against an installed tree and runs them.
#   test_installed.sh BUILD_FOLDER NILIO_PROGRAM
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
build=$1
nilio=$2
work=$build/installed
rm -rf "$work"
mkdir -p "$work"
cmake --install "$build" --prefix "$work/prefix" >"$work/install.txt"

for file in bin/niliod bin/nilio-publisher bin/nilio-mapper bin/nilio include/nilio/core/odometry.hpp include/nilio/drivers/velodyne/decoder.hpp \
            etc/nilio/vehicle.yaml share/nilio/reference.yaml share/nilio/nilio.schema.json share/nilio/dbc/xsens_mti.dbc \
            lib/systemd/system/niliod.service lib/sysusers.d/nilio.conf share/man/man8/niliod.8 \
            share/bash-completion/completions/nilio share/doc/nilio/LICENSE; do
  [[ -e $work/prefix/$file ]] || { echo "installed tree: $file is missing" >&2; exit 1; }
done
grep -q "^ExecStart=$work/prefix/bin/niliod --config $work/prefix/etc/nilio/vehicle.yaml" "$work/prefix/lib/systemd/system/niliod.service" ||
  { echo "installed tree: niliod.service does not name the prefix" >&2; exit 1; }
echo '# of the owner' >>"$work/prefix/etc/nilio/vehicle.yaml"
cmake --install "$build" --prefix "$work/prefix" >>"$work/install.txt"
grep -q '# of the owner' "$work/prefix/etc/nilio/vehicle.yaml" || { echo "installed tree: a second installation replaced vehicle.yaml" >&2; exit 1; }
cmake -S "$source_dir/core/examples" -B "$work/examples" -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_BUILD_TYPE=Release >"$work/configure.txt"
cmake --build "$work/examples" >"$work/build.txt"

# Without CMake: the flags of pkg-config.
PKG_CONFIG_PATH=$(find "$work/prefix" -name pkgconfig -type d)
export PKG_CONFIG_PATH
read -ra flags < <(pkg-config --cflags --libs nilio-drivers)
c++ -std=c++20 -O0 "$source_dir/core/examples/odometry_from_pcap.cpp" "${flags[@]}" -o "$work/with_pkg_config"
# The flags suffice for every function of the libraries.
echo 'int main() {}' | c++ -x c++ - -x none -Wl,--whole-archive "${flags[@]}" -Wl,--no-whole-archive -o "$work/whole_libraries"

# A simulated capture through the second example, evaluated against its truth.
"$nilio" simulate "$work/drive" --sensor vlp16 --imu none --duration 6 >"$work/simulate.txt"
"$work/examples/odometry_from_pcap" "$work/drive/lidar.pcap" >"$work/trajectory.tum"
poses=$(wc -l <"$work/trajectory.tum")
((poses >= 50)) || { echo "odometry_from_pcap: $poses poses of a drive of 6 s" >&2; exit 1; }
"$work/with_pkg_config" "$work/drive/lidar.pcap" | cmp - "$work/trajectory.tum"
"$nilio" evaluate "$work/drive/truth.tum" "$work/trajectory.tum" --json "$work/evaluation.json"

data=${NILIO_DATA:-$source_dir/../shared/data}
archive=$data/kitti/odometry_04_frames_000-050.tar.xz
if [[ ! -e $archive ]]; then
  echo "skipped: odometry_from_kitti: no data"
  exit 0
fi
tar -xJf "$archive" -C "$work"
sequence=$work/04
"$work/examples/odometry_from_kitti" "$sequence" >"$work/kitti.txt"
[[ $(wc -l <"$work/kitti.txt") == 51 ]] || { echo "odometry_from_kitti: not 51 poses" >&2; exit 1; }
# 69.13 m of true path; end-point distance of the estimate.
awk 'END { d = sqrt($4^2 + $8^2 + $12^2); if (d < 67 || d > 71) { print "odometry_from_kitti: end after " d " m"; exit 1 } }' "$work/kitti.txt"
