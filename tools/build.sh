#!/usr/bin/env bash
# Configures and builds one preset: build.sh [release|debug|asan|tsan|fuzz] [target ...]
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}
shift || true
tests=ON
# Without Catch2 everything except the tests is built.
dpkg-query --show catch2 >/dev/null 2>&1 || tests=OFF
cmake --preset "$preset" -DBUILD_TESTING=$tests >/dev/null
if (($# > 0)); then
  cmake --build --preset "$preset" --target "$@"
else
  cmake --build --preset "$preset"
fi
