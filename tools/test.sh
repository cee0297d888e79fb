#!/usr/bin/env bash
# Sets up, builds and runs the tests.
#   test.sh            release build, all tests (those of CAN run inside guests: tests/vm), the sanitizer runs of the daemon's
#                      libraries, and a short run of every fuzz target
#   test.sh --quick    release build and its tests only
#   test.sh --full     the sanitizers run the tests of the tools, too
set -euo pipefail
cd "$(dirname "$0")/.."
case ${1:-} in
  '' | --quick | --full) ;;
  *) echo "test.sh: unknown option $1; known are --quick and --full" >&2; exit 2 ;;
esac

tools/setup.sh --tests
tools/build.sh release
ctest --preset release
# ctest counts skipped tests without their reasons.
grep --extended-regexp '^(skipped|undecided):' build/release/Testing/Temporary/LastTest.log || true

if [[ ${1:-} != --quick ]]; then
  if [[ ${1:-} == --full ]]; then
    tools/build.sh asan
    ctest --preset asan
  else
    tools/build.sh asan test_core test_drivers test_ipc test_dds test_daemon fuzz_rtps
    ctest --preset asan --exclude-regex '^tools$'
  fi
  tools/build.sh tsan test_ipc test_daemon
  ctest --preset tsan --tests-regex '^(ipc|daemon)$'
  tools/build.sh fuzz
  ctest --preset fuzz
fi
