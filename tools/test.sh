#!/usr/bin/env bash
# Sets up, builds and passes the tests.
#   test.sh            release build, all tests (those of CAN run inside guests: tests/vm), the sanitizer runs, and a short run
#                      of every fuzz target
#   test.sh --quick    release build and its tests only
set -euo pipefail
cd "$(dirname "$0")/.."

tools/setup.sh --tests
tools/build.sh release
ctest --preset release
# ctest counts the tests that were skipped, and keeps the reasons to itself.
grep --extended-regexp '^(skipped|undecided):' build/release/Testing/Temporary/LastTest.log || true

if [[ ${1:-} != --quick ]]; then
  tools/build.sh asan
  ctest --preset asan
  tools/build.sh tsan test_ipc test_daemon
  ctest --preset tsan --tests-regex '^(ipc|daemon)$'
  tools/build.sh fuzz
  ctest --preset fuzz
fi
