#!/usr/bin/env bash
# Configures and builds one preset: build.sh [release|debug|asan|tsan|fuzz] [target ...]
# Uses ccache where it is installed.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}
shift || true
tests=ON
# Without Catch2 everything except the tests is built.
dpkg-query --show catch2 >/dev/null 2>&1 || tests=OFF
# The compiler cache serves clones in other folders, too: paths are hashed relative to the root, and without the folder of the build.
export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$PWD} CCACHE_NOHASHDIR=1
cmake --preset "$preset" -DBUILD_TESTING=$tests -DNILIO_COMPILER_CACHE=ON >/dev/null
if (($# > 0)); then
  cmake --build --preset "$preset" --target "$@"
else
  cmake --build --preset "$preset"
fi
